"""RVQ indices: stages from any to any, and no index without a codeword."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from scarfmt.codecs.indices import get_indices, put_indices
from scarfmt.container.schema import Stream
from scarfmt.entropy.keys import TableKey
from tests.samples.codec_samples import Recorder, reader_of


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 40), st.integers(1, 8))
def test_stages_come_back_from_anywhere_to_anywhere(seed: int, count: int, stages: int) -> None:
    """Anchors of any class with any stages received before; codeword 4095 included."""
    rng = np.random.default_rng(seed)
    before, after = np.sort(rng.integers(0, stages + 1, (2, count)), axis=0)
    classes = rng.integers(0, 15, count)
    indices = rng.choice([0, 1, 50, 4095], (count, stages)).astype(np.int16)
    reader = reader_of(lambda emitter: put_indices(emitter, indices, classes, before, after))
    place = np.arange(stages)
    found = np.where(place < before[:, None], indices, 0).astype(np.int16)
    get_indices(reader, found, classes, before, after, (4096, 4096))
    reader.finish()
    assert np.array_equal(found, np.where(place < after[:, None], indices, 0))


def test_the_context_is_class_and_whether_the_stage_before_chose_0() -> None:
    """SPEC §7.6; stage 1 has no stage before it."""
    recorder = Recorder()
    indices = np.array([[0, 7], [3, 8], [0, 9]], np.int16)
    put_indices(recorder, indices, np.array([0, 0, 2]), np.zeros(3, np.int64), np.full(3, 2))
    key = TableKey(Stream.INDICES, 0, 0, 0)
    expected = [(1, 0, [0, 3]), (1, 32, [0]), (2, 0, [8]), (2, 1, [7]), (2, 33, [9])]
    assert recorder.groups == [(key._replace(component=s, context=c), values) for s, c, values in expected]
