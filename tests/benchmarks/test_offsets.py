"""The possible gains of offsets: entropies are right, and there are rows for every layer."""

import numpy as np
import pytest

from benchmarks.offsets import classes, kilobytes, offsets
from fuzz.testing.scenes import random_scene
from scarfmt.coding.writer import write_scene
from scarfmt.container.schema import Profile


def test_a_context_that_tells_the_value_leaves_its_tables_alone() -> None:
    """Four values that are as frequent take two bits each; knowing them beforehand takes nothing but tables."""
    values = np.tile(np.arange(4), 1000)[:, None].repeat(3, axis=1)
    tables = 3 * 4 * 7 / 8e3
    assert kilobytes(values) == pytest.approx(3 * 4000 * 2 / 8e3 + tables)
    assert kilobytes(values, values) == pytest.approx(tables)
    assert kilobytes(values, np.zeros_like(values)) == pytest.approx(kilobytes(values))


def test_classes_hold_equally_many() -> None:
    counts = np.bincount(classes(np.random.default_rng(0).normal(size=8000)))
    assert len(counts) == 8
    assert counts.min() > 900


def test_every_context_is_measured_on_a_file() -> None:
    """All that a decoder knows before an offset is tried, each against the same offsets."""
    found = dict(offsets(write_scene(random_scene(3, Profile.ANCHOR))))
    assert len(found) == 13
    assert min(found.values()) > 0
