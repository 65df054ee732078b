"""LAYER block: channel table and layer row, and what a newer file would say here."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from scarfmt.blocks.layer import pack_layer, unpack_layer
from scarfmt.scene.model import (
    MAX_CLASSES,
    MAX_DEPTHS,
    Channel,
    DecodedContext,
    LayerRow,
)
from scarfmt.scene.streams import CHANNEL_STREAMS

BYTE = st.integers(0, 255)
CONTEXTS = st.builds(DecodedContext, BYTE, st.lists(st.integers(0, 65535), max_size=MAX_DEPTHS).map(tuple))
NOTHING = (), DecodedContext()
STEPS = st.floats(min_value=5e-324, allow_infinity=False)


@st.composite
def channel_tables(draw: st.DrawFn) -> tuple[Channel, ...]:
    out = []
    for stream in draw(st.lists(st.sampled_from(CHANNEL_STREAMS), max_size=4)):
        steps = draw(st.lists(STEPS, min_size=1, max_size=5))
        out.append(Channel(stream, tuple(steps)))
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
