"""RVQ indices: their contexts."""

from __future__ import annotations

import numpy as np

from scarfmt.codecs.indices import put_indices
from scarfmt.container.schema import Stream
from scarfmt.entropy.keys import TableKey
from tests.samples.codec_samples import Recorder


def test_the_context_is_class_and_whether_the_stage_before_chose_0() -> None:
    """SPEC §7.6; stage 1 has no stage before it."""
    recorder = Recorder()
    indices = np.array([[0, 7], [3, 8], [0, 9]], np.int16)
    put_indices(recorder, indices, np.array([0, 0, 2]), np.zeros(3, np.int64), np.full(3, 2))
    key = TableKey(Stream.INDICES, 0, 0, 0)
    expected = [(1, 0, [0, 3]), (1, 32, [0]), (2, 0, [8]), (2, 1, [7]), (2, 33, [9])]
    assert recorder.groups == [(key._replace(component=s, context=c), values) for s, c, values in expected]
