"""Classes of the anchors that appear in a layer."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from scarfmt.codecs.classes import get_classes, put_classes
from scarfmt.container.schema import Stream
from scarfmt.entropy.keys import TableKey
from scarfmt.scene.model import MAX_CLASSES
from tests.samples.codec_samples import Recorder, reader_of

KEY = TableKey(Stream.CLASSES, 0, 0, 0)


@given(st.data())
def test_classes_come_back(data: st.DataObject) -> None:
    """Any range of new classes."""
    first = data.draw(st.integers(0, MAX_CLASSES - 1))
    past = data.draw(st.integers(first + 1, MAX_CLASSES))
    classes = np.array(data.draw(st.lists(st.integers(first, past - 1), max_size=40)), np.int64)
    reader = reader_of(lambda emitter: put_classes(emitter, classes, first, past))
    assert get_classes(reader, len(classes), first, past).tolist() == classes.tolist()
    reader.finish()


def test_a_single_new_class_costs_nothing() -> None:
    """No symbol is coded where there is no choice."""
    recorder = Recorder()
    put_classes(recorder, np.full(9, 4), 4, 5)
    assert recorder.groups == []
