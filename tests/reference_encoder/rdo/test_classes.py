"""Classes: who is in which, who of a class comes first where it is cut in two, and what parts cost."""

from __future__ import annotations

import numpy as np
import pytest

from reference_encoder.rdo.classes import Classes, classify, measure_colour_shift, rank_by_coverage, rank_with_colour
from reference_encoder.tuning import NEIGHBOURS


def classes_of(seed: int = 1, count: int = 900) -> Classes:
    """Three classes of anchors anywhere."""
    draw = np.random.default_rng(seed)
    of = draw.integers(0, 3, count)
    rank = rank_by_coverage(draw.normal(size=(count, 3)), of, draw.normal(size=count))
    fixed = np.array([10.0, 20.0, 40.0])
    return Classes(of=of, count=3, importance=np.ones(count), coverage_rank=rank, presence_bits=lambda _: fixed)


def test_of_neighbours_who_covers_most_comes_first() -> None:
    """Anchors on a line: of each eight neighbours of a class the largest has rank 0, and ranks are even."""
    count = 64
    positions = np.stack([np.arange(count), np.zeros(count), np.zeros(count)], axis=1)
    extent = np.random.default_rng(2).normal(size=count)
    rank = rank_by_coverage(positions, np.zeros(count, np.int64), extent).reshape(-1, NEIGHBOURS)
    assert (np.sort(rank, axis=1) == np.arange(NEIGHBOURS) / NEIGHBOURS).all()
    assert (rank.argmin(axis=1) == extent.reshape(-1, NEIGHBOURS).argmax(axis=1)).all()


def test_split_puts_the_parts_first() -> None:
    """Classes 0, half of 1, a quarter of 2, then the rest of 1 and of 2; bits are shared out."""
    classes = classes_of()
    split = classes.split((1.0, 0.5, 0.25))
    assert split.count == 5
    assert classes.coverage_rank is not None
    assert (np.isin(split.of, (0, 1, 2)) == (classes.coverage_rank < np.array((1.0, 0.5, 0.25))[classes.of])).all()
    for new, old in enumerate((0, 1, 2, 1, 2)):
        assert (classes.of[split.of == new] == old).all()
    assert split.presence_bits(1.0) == pytest.approx([10, 10, 10, 10, 30])
    assert abs((split.of == 1).sum() - (split.of == 3).sum()) <= NEIGHBOURS


def test_split_of_the_first_classes_leaves_later_ones_behind_the_rest() -> None:
    """Classes that are not shown at all come last."""
    split = classes_of().split((1.0, 0.5))
    assert (np.unique(split.of[classes_of().of == 2]) == [3]).all()
    assert split.presence_bits(1.0) == pytest.approx([10, 10, 10, 40])


def test_classify_orders_by_importance_and_drops_the_invisible() -> None:
    """Class 0 is the most important; what does not pay for its bits is dropped; no class is empty."""
    importance = np.array([1e3, 1.0, 0.99, 30.0, 1e-9, 0.0])
    classes, count = classify(importance, 1e-3, 40, 8)
    assert classes[0] == 0
    assert classes[0] <= classes[3] <= classes[1] == classes[2]
    assert classes[4] == classes[5] == -1
    assert set(classes[classes >= 0]) == set(range(count))


def test_classify_keeps_something() -> None:
    """A scene nobody sees still keeps its most visible anchor."""
    classes, count = classify(np.zeros(5), 1e-3, 40, 8)
    assert count == 1
    assert (classes >= 0).any()


def test_importance_with_colour_ranks_between_both_and_drops_the_same() -> None:
    """Half of the colour in the logarithm is the geometric mean, at the scale of absence; who is dropped stays so."""
    absence, colour = np.array([8.0, 2.0, 1e-9, 1.0]), np.array([1.0, 64.0, 5.0, 1.0])
    assert rank_with_colour(absence, colour, 0.0, 1e-3) is absence
    ranked = rank_with_colour(absence, colour, 0.5, 1e-3)
    # Of those worth sending: sqrt(8 * 1), sqrt(2 * 64), sqrt(1 * 1), at the geometric mean of absence.
    by_mean = np.array([8.0, 128.0, 1.0]) ** 0.5
    kept = [0, 1, 3]
    np.testing.assert_allclose(ranked[kept] / ranked[3], by_mean / by_mean[2])
    assert np.log(ranked[kept]).mean() == pytest.approx(np.log(absence[kept]).mean())
    assert ranked[2] == absence[2]
    shift = measure_colour_shift(absence, colour, 1e-3)
    np.testing.assert_allclose(rank_with_colour(absence[1:], colour[1:], 0.5, 1e-3, shift), ranked[1:])
    unseen = rank_with_colour(absence, np.array([1.0, 1.0, 1.0, 0.0]), 0.5, 1e-3)
    assert (unseen > 1e-3).tolist() == (absence > 1e-3).tolist()
