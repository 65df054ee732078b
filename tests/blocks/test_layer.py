"""LAYER block: channel table and layer row, and what a newer file would say here."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scarfmt.blocks.layer import pack_layer, unpack_layer
from scarfmt.container.bytefields import signed_varint, unsigned_varint
from scarfmt.container.schema import Stream
from scarfmt.errors import LimitExceeded, ScarError, Unsupported
from scarfmt.scene.model import (
    MAX_CHANNELS,
    MAX_CLASSES,
    MAX_COMPONENTS,
    MAX_DEPTHS,
    Channel,
    ContextRule,
    DecodedContext,
    LayerRow,
)
from scarfmt.scene.streams import CHANNEL_STREAMS
from tests.samples.codec_samples import refuses

BYTE = st.integers(0, 255)
RULES = st.builds(ContextRule, st.booleans(), BYTE, BYTE, st.integers(-(2**32), 2**32 - 1), BYTE)
CONTEXTS = st.builds(DecodedContext, BYTE, st.lists(st.integers(0, 65535), max_size=MAX_DEPTHS).map(tuple))
NOTHING = (), DecodedContext()
STEPS = st.floats(min_value=5e-324, allow_infinity=False)


@st.composite
def channel_tables(draw: st.DrawFn) -> tuple[Channel, ...]:
    out = []
    for stream in draw(st.lists(st.sampled_from(CHANNEL_STREAMS), max_size=4)):
        rules = draw(st.lists(RULES, min_size=1, max_size=5))
        steps = draw(st.lists(STEPS, min_size=len(rules), max_size=len(rules)))
        out.append(Channel(stream, tuple(steps), tuple(rules)))
    return tuple(out)


@settings(deadline=None)
@given(channel_tables(), CONTEXTS, st.integers(0, MAX_CLASSES), st.data())
def test_rows_and_openings_come_back(
    channels: tuple[Channel, ...], context: DecodedContext, classes: int, data: st.DataObject
) -> None:
    """Channel table and context in layer 1 alone; later layers are read with them."""
    stages = tuple(data.draw(st.lists(BYTE, min_size=classes, max_size=classes)))
    steps = tuple(tuple(data.draw(st.lists(BYTE, min_size=len(channels), max_size=len(channels)))) for _ in stages)
    row, opening = LayerRow(stages, steps, data.draw(st.booleans())), (channels, context)
    assert unpack_layer(pack_layer(row, opening), 1, NOTHING) == (row, opening)
    assert unpack_layer(pack_layer(row, None), 2, opening) == (row, opening)


def channel(
    stream: int = Stream.SCALE, components: int = 1, by_class: int = 1, count: int = 1, context: bytes = b"\1\1\3"
) -> bytes:
    """A channel table of `count` equal channels, and a context."""
    rule = struct.pack("<d4B", 0.5, by_class, 255, 0, 0) + signed_varint(-4)
    return unsigned_varint(count) + (bytes([stream, components]) + rule * components) * count + context


ROW = b"\x01\x00\x02"


def test_the_hand_made_block_is_readable() -> None:
    """The refusals below are for what was crafted."""
    rule = ContextRule(True, 255, 0, -4, 0)
    assert unpack_layer(b"\0" + channel() + ROW, 1, NOTHING) == (
        LayerRow((0,), ((2,),)),
        ((Channel(Stream.SCALE, (0.5,), (rule,)),), DecodedContext(1, (3,))),
    )


BAD = {
    "unknown stream": (channel(stream=200) + ROW, "bad-channel"),
    "stream that is no channel": (channel(stream=Stream.INDICES) + ROW, "bad-channel"),
    "no component": (channel(components=0) + ROW, "bad-channel"),
    "too many components": (channel(components=MAX_COMPONENTS + 1) + ROW, "bad-channel"),
    "by_class 2": (channel(by_class=2) + ROW, "bad-channel"),
    "short channel": (channel(context=b"")[:-1], "payload-short"),
    "long occupancy": (channel(context=b"\0\1\x80\x80\x04") + ROW, "bad-varint"),
    "short row": (channel() + ROW[:-1], "payload-short"),
    "long": (channel() + ROW + b"\0", "payload-long"),
}


@pytest.mark.parametrize("name", BAD)
def test_blocks_that_break_the_rule_are_refused(name: str) -> None:
    """Each rule a payload can break by itself; those of whole tables are SceneModel.check's."""
    data, refusal = BAD[name]
    refuses(refusal, lambda: unpack_layer(b"\0" + data, 1, NOTHING))


@pytest.mark.parametrize("cut", [b"\1\11", b"\1\5\0", b"\1\5\1" + bytes(8) + b"\2"])
def test_each_number_of_a_channel_is_checked_before_the_next_is_read(cut: bytes) -> None:
    """A wrong stream kind, number of components or by_class at the end of a block (SPEC R-7.11-2)."""
    refuses("bad-channel", lambda: unpack_layer(b"\0" + cut, 1, NOTHING))


def test_an_empty_block_is_refused() -> None:
    """A LAYER block has at least an entropy mode."""
    refuses("payload-short", lambda: unpack_layer(b"", 1, NOTHING))


@pytest.mark.parametrize("mode", [2, 255])
def test_other_entropy_modes_need_a_newer_reader(mode: int) -> None:
    """Said before anything else is looked at."""
    with pytest.raises(Unsupported) as caught:
        unpack_layer(bytes([mode]) + b"\xff garbage", 1, NOTHING)
    assert caught.value.refusal == "unsupported-entropy-mode"


@pytest.mark.parametrize(
    "data", [channel(count=MAX_CHANNELS + 1) + ROW, channel() + bytes([MAX_CLASSES + 1]) + bytes(2 * MAX_CLASSES + 2)]
)
def test_numbers_above_the_maxima_pass_a_limit(data: bytes) -> None:
    """Too many channels, too many classes."""
    with pytest.raises(LimitExceeded):
        unpack_layer(b"\0" + data, 1, NOTHING)


@settings(max_examples=300)
@given(st.binary(max_size=60), st.integers(1, 2))
def test_garbage_raises_only_our_errors(data: bytes, layer: int) -> None:
    """In layer 1 and later."""
    opening = (Channel(Stream.SCALE, (0.5,), (ContextRule(),)),), DecodedContext()
    try:
        row, _ = unpack_layer(data, layer, opening)
    except ScarError:
        return
    assert len(row.stages) == len(row.steps) <= MAX_CLASSES
