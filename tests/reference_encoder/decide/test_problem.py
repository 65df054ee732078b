"""Classes cut in two: who of a class comes first, and what parts cost."""

from __future__ import annotations

import numpy as np
import pytest

from reference_encoder.decide.problem import Classes, standing
from reference_encoder.tuning import NEIGHBOURS


def classes_of(seed: int = 1, count: int = 900) -> Classes:
    """Three classes of anchors anywhere."""
    draw = np.random.default_rng(seed)
    of = draw.integers(0, 3, count)
    rank = standing(draw.normal(size=(count, 3)), of, draw.normal(size=count))
    fixed = np.array([10.0, 20.0, 40.0])
    return Classes(of=of, count=3, importance=np.ones(count), standing=rank, presence_bits=lambda _: fixed)


def test_of_neighbours_who_covers_most_comes_first() -> None:
    """Anchors on a line: of each eight neighbours of a class the largest has rank 0, and ranks are even."""
    count = 64
    positions = np.stack([np.arange(count), np.zeros(count), np.zeros(count)], axis=1)
    extent = np.random.default_rng(2).normal(size=count)
    rank = standing(positions, np.zeros(count, np.int64), extent).reshape(-1, NEIGHBOURS)
    assert (np.sort(rank, axis=1) == np.arange(NEIGHBOURS) / NEIGHBOURS).all()
    assert (rank.argmin(axis=1) == extent.reshape(-1, NEIGHBOURS).argmax(axis=1)).all()


def test_split_puts_the_parts_first() -> None:
    """Classes 0, half of 1, a quarter of 2, then the rest of 1 and of 2; bits are shared out."""
    classes = classes_of()
    split = classes.split((1.0, 0.5, 0.25))
    assert split.count == 5
    assert (np.isin(split.of, (0, 1, 2)) == classes.shown((1.0, 0.5, 0.25))).all()
    for new, old in enumerate((0, 1, 2, 1, 2)):
        assert (classes.of[split.of == new] == old).all()
    assert split.presence_bits(1.0) == pytest.approx([10, 10, 10, 10, 30])
    assert abs((split.of == 1).sum() - (split.of == 3).sum()) <= NEIGHBOURS


def test_split_of_the_first_classes_leaves_later_ones_behind_the_rest() -> None:
    """Classes that are not shown at all come last."""
    split = classes_of().split((1.0, 0.5))
    assert (np.unique(split.of[classes_of().of == 2]) == [3]).all()
    assert split.presence_bits(1.0) == pytest.approx([10, 10, 10, 40])
