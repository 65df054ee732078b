"""Classes of the anchors that appear in a layer: what is not coded."""

from __future__ import annotations

import numpy as np

from scarfmt.codecs.classes import put_classes
from scarfmt.container.schema import Stream
from scarfmt.entropy.keys import TableKey
from tests.samples.codec_samples import Recorder

KEY = TableKey(Stream.CLASSES, 0, 0, 0)


def test_a_single_new_class_costs_nothing() -> None:
    """No symbol is coded where there is no choice."""
    recorder = Recorder()
    put_classes(recorder, np.full(9, 4), 4, 5)
    assert recorder.groups == []
