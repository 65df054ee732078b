"""Masks and offsets of the anchor profile: each slot is turned on once and placed once."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from scarfmt.codecs.masks import get_offsets, put_masks, put_offsets
from scarfmt.container.schema import Stream
from scarfmt.entropy.keys import TableKey
from scarfmt.scene.model import Channel
from tests.samples.codec_samples import Recorder, reader_of

MASK = TableKey(Stream.MASKS, 0, 0, 0)
EDGE = 2**31 - 1


CHANNEL = Channel(Stream.OFFSETS, (0.1, 0.1, 0.2))


def test_the_context_is_how_many_slots_are_on_by_then() -> None:
    """Slots turned on earlier in the same layer count (SPEC §7.4)."""
    before = np.array([[True, False, False], [False, False, False]])
    after = np.array([[True, True, False], [False, True, True]])
    recorder = Recorder()
    put_masks(recorder, before, after)
    expected = [(0, [0]), (0, [1]), (1, [1]), (1, [1]), (2, [0])]
    assert recorder.groups == [(MASK._replace(context=context), bits) for context, bits in expected]


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 20), st.integers(1, 32))
def test_offsets_come_back_for_slots_that_turn_on(seed: int, anchors: int, slots: int) -> None:
    """Others keep what they had; extremes of 32 bits included."""
    rng = np.random.default_rng(seed)
    turned_on = rng.random((anchors, slots)) < 0.4
    values = rng.choice([0, 1, -1, 77, EDGE, -EDGE], (anchors, slots, 3)).astype(np.int32)
    reader = reader_of(lambda emitter: put_offsets(emitter, CHANNEL, values, turned_on))
    found = np.full((anchors, slots, 3), 5, np.int32)
    get_offsets(reader, CHANNEL, found, turned_on)
    reader.finish()
    assert np.array_equal(found, np.where(turned_on[:, :, None], values, 5))
