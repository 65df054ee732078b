"""Masks and offsets of the anchor profile: each slot is turned on once and placed once."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from scarfmt.codecs.masks import get_offsets, put_offsets
from scarfmt.container.schema import Stream
from scarfmt.scene.model import Channel
from tests.samples.codec_samples import reader_of

EDGE = 2**31 - 1


CHANNEL = Channel(Stream.OFFSETS, (0.1, 0.1, 0.2))


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
