"""Layers of tiles within a number of Gaussians: no holes first, then what gains most, and never too many."""

from __future__ import annotations

import math

import numpy as np
import pytest

from scarfmt.streaming.boxes import Boxes
from scarfmt.streaming.levels import Parts, chosen, meets_picture, parts_of
from scarfmt.streaming.plan import SceneIndex
from scarfmt.streaming.view import Camera
from tests.streaming.plan_cases import camera_of, random_case

EYE = Camera(np.zeros(3), np.array([0.0, 0, 1]), np.array([0.0, -1, 0]), math.radians(60), 640, 480)


def row(counts: list[list[int]], depths: list[float]) -> SceneIndex:
    """Tiles of side 1 at these depths before the eye, each layer of as many bytes as 10 for a Gaussian."""
    low = np.array([[-0.5, -0.5, depth] for depth in depths])
    new = np.array(counts, np.int64)
    return SceneIndex(np.hstack([low, low + 1]), new * 10.0, new, np.zeros(new.shape[1]))


def levels(index: SceneIndex, budget: float, *, outside: bool = False, layers: int | None = None) -> list[int]:
    """Layers of each tile."""
    tiles, most = index.bytes.shape
    every = np.arange(tiles)
    parts = Parts.joined(
        [parts_of(0, index, None, EYE, layers=layers or most, tiles=every, outside=outside)],
    )
    _, tile, found, _ = chosen(parts, parts.within(budget))
    out = np.zeros(tiles, np.int64)
    out[tile] = found
    return out.tolist()


def test_near_tiles_get_more_layers_than_far_ones() -> None:
    index = row([[10, 10, 10]] * 3, [2, 8, 60])
    assert levels(index, 30) == [1, 1, 1]
    assert levels(index, 50) == [3, 1, 1]
    assert levels(index, 70) == [3, 3, 1]
    assert levels(index, math.inf) == [3, 3, 3]
    assert levels(index, math.inf, layers=2) == [2, 2, 2]


def test_what_is_out_of_the_picture_gets_nothing_or_its_first_layer() -> None:
    index = row([[10, 10]] * 2, [3, -5])
    assert levels(index, math.inf) == [2, 0]
    assert levels(index, math.inf, outside=True) == [2, 1]
    assert levels(index, 20, outside=True) == [1, 1]


def test_too_small_a_budget_leaves_out_what_is_worth_least() -> None:
    index = row([[10, 5]] * 3, [2, 8, 60])
    assert levels(index, 20) == [1, 1, 0]
    assert levels(index, 9) == [0, 0, 0]


def test_what_does_not_fit_is_passed_over_and_what_needs_it_too() -> None:
    """Smaller layers of other tiles still come, later ones of the same tile do not."""
    index = row([[1, 90, 1], [1, 5, 5]], [2, 8])
    assert levels(index, 50) == [1, 3]


@pytest.mark.parametrize("seed", range(30))
def test_budgets_are_kept_and_used_and_more_is_never_less(seed: int) -> None:
    case = random_case(seed)
    tiles, layers = case["tiles"], case["layers"]
    counts = np.array(case["counts"], np.int64).reshape(tiles, layers)
    index = SceneIndex(
        np.array(case["boxes"]).reshape(tiles, 6),
        np.array(case["bytes"], float).reshape(tiles, layers),
        counts,
        np.zeros(layers),
    )
    camera = camera_of(case["camera"])
    assert camera is not None
    parts = Parts.joined([parts_of(0, index, None, camera, layers=layers, tiles=np.arange(tiles), outside=True)])
    seen = meets_picture(Boxes(index.cubes[:, :3], index.cubes[:, 3:]), camera)
    for budget in (0, 10_000, 50_000, math.inf):
        taken = parts.within(budget)
        _, tile, found, gaussians = chosen(parts, taken)
        assert len(set(tile.tolist())) == len(tile)
        assert gaussians.tolist() == [int(counts[t, :k].sum()) for t, k in zip(tile, found, strict=True)]
        assert gaussians.sum() <= budget
        left_out = {(t, low) for t, low in zip(parts.tile[~taken].tolist(), parts.low[~taken].tolist(), strict=True)}
        fits = parts.gaussians <= budget - gaussians.sum()
        first = {tile: min(low for t, low in left_out if t == tile) for tile, _ in left_out}
        # Whatever would still fit needs a part that did not.
        for t, low in zip(parts.tile[~taken & fits].tolist(), parts.low[~taken & fits].tolist(), strict=True):
            assert low > first[t]
    assert sorted(tile.tolist()) == list(range(tiles))
    assert (found == np.where(seen[tile], layers, 1)).all()


def test_only_what_is_wholly_outside_does_not_meet_the_picture() -> None:
    """A large box with the eye in it may have none of the places that a share is counted by in the picture."""

    def meets(low: list[float], high: list[float]) -> bool:
        return bool(meets_picture(Boxes(np.array([low]), np.array([high])), EYE)[0])

    assert meets([-100, -100, -100], [100, 100, 100])
    assert meets([-1, -1, 5], [1, 1, 6])
    assert not meets([-1, -1, -6], [1, 1, -5])
    assert not meets([50, -1, 5], [51, 1, 6])
    assert not meets([-1, 50, 5], [1, 51, 6])
    assert meets([3, 0, 5], [90, 1, 6])


def test_parts_of_several_files_are_one_order() -> None:
    near, far = row([[10, 10]], [2]), row([[10, 10]], [9])
    every = np.arange(1)
    parts = Parts.joined(
        [parts_of(n, one, None, EYE, layers=2, tiles=every, outside=False) for n, one in enumerate((far, near))]
    )
    file, _, found, _ = chosen(parts, parts.within(30))
    assert (file.tolist(), found.tolist()) == ([1, 0], [2, 1])
    assert len(Parts.joined([]).within(5)) == 0
