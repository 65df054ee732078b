"""Tiles are disjoint cubes of bounded size, and cell plus residual is the position."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from reference_encoder.rdo.lattice import Placement, check_crowd, cut_cubes, find_far, place
from reference_encoder.tuning import LARGE_SCENE, LARGE_SCENE_TILE_ANCHORS, TILE_ANCHORS
from scarfmt.container.morton import deinterleave
from scarfmt.limits import MAX_LOCAL_BITS, MAX_TILE_DEPTH
from tests.samples.codec_samples import refuses


def rebuilt(placement: Placement) -> np.ndarray:
    """Positions by SPEC §9.1 from cells and residuals."""
    lattice = placement.lattice
    tiles = [placement.tiles[t] for t in placement.tile]
    depth = np.array([tile.depth for tile in tiles])
    cell = 2.0 ** np.array([tile.shift for tile in tiles])[:, None]
    corner = deinterleave(np.array([tile.prefix for tile in tiles], np.uint64)) * 2.0 ** (lattice.bits - depth)[:, None]
    local = deinterleave(placement.codes) * cell
    return np.array(lattice.origin) + lattice.voxel * (corner + local + cell / 2 + cell * placement.residual)


@settings(max_examples=60)
@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(1, 200),
    magnitude=st.sampled_from([1e-12, 1e-3, 1.0, 1e4]),
    shift=st.sampled_from([0.0, 1.0, 1e6]),
    outliers=st.booleans(),
    step=st.sampled_from([1e-6, 1e-3, 1e-1, 10.0]),
)
def test_cells_hold_their_anchors(
    seed: int, count: int, magnitude: float, shift: float, outliers: bool, step: float
) -> None:
    """Whatever the coordinates, cell centre plus residual is the position to binary64's precision."""
    draw = np.random.default_rng(seed)
    positions = draw.normal(size=(count, 3)) * magnitude + shift
    if outliers:
        positions[0] *= 1e4
    placement = place(positions, np.full(count, step * magnitude))
    assert np.abs(placement.residual).max() <= 0.5
    reach = float(np.abs(positions).max())
    extent = float(np.ptp(positions, axis=0).max())
    assert np.abs(rebuilt(placement) - positions).max() <= 1e-9 * extent + 1e-12 * reach
    for tile in placement.tiles:
        assert 0 <= placement.lattice.bits - tile.depth - tile.shift <= MAX_LOCAL_BITS


@pytest.mark.parametrize(
    ("count", "most"), [(3 * TILE_ANCHORS, TILE_ANCHORS), (LARGE_SCENE + 1, LARGE_SCENE_TILE_ANCHORS)]
)
def test_large_clouds_are_split(count: int, most: int) -> None:
    """No tile holds more than the default for so many anchors while cubes can still be halved."""
    positions = np.random.default_rng(0).random((count, 3))
    placement = place(positions, np.full(len(positions), 0.01))
    assert len(placement.tiles) >= 8
    assert most / 8 < np.bincount(placement.tile).max() <= most


def test_tiles_are_as_small_as_asked_for_and_cells_are_still_right() -> None:
    """Smaller tiles are more tiles of the same anchors; the position does not move."""
    positions = np.random.default_rng(2).normal(size=(5000, 3))
    wanted = np.full(len(positions), 1e-3)
    counts = []
    for most in (100, 1000, 5000):
        placement = place(positions, wanted, most)
        sizes = np.bincount(placement.tile, minlength=len(placement.tiles))
        assert sizes.min() >= 1
        assert sizes.max() <= most
        assert np.abs(rebuilt(placement) - positions).max() <= 1e-9
        counts.append(len(sizes))
    assert counts[0] > counts[1] > counts[2] == 1
    coarse = place(positions, wanted * 1e-5, 100, lattice_bits=MAX_TILE_DEPTH)
    assert min(tile.shift for tile in coarse.tiles) == 0
    assert np.abs(rebuilt(coarse) - positions).max() <= 1e-9


@settings(max_examples=100)
@given(codes=st.lists(st.integers(0, 8**4 - 1), min_size=1, max_size=60).map(sorted), most=st.integers(1, 20))
def test_cubes_are_the_largest_that_hold_few_enough(codes: list[int], most: int) -> None:
    """Every point is in its cube, cubes ascend apart, and each parent would have held too many."""
    path = np.array(codes, np.uint64)
    depths, prefixes, firsts = (found.tolist() for found in cut_cubes(path, 4, most))
    past = [*firsts[1:], len(codes)]
    assert firsts[0] == 0
    for depth, prefix, first, end in zip(depths, prefixes, firsts, past, strict=True):
        assert {code >> 3 * (4 - depth) for code in codes[first:end]} == {prefix}
        assert end - first <= most or depth == 4
        if depth:
            parent = prefix >> 3
            assert sum(code >> 3 * (5 - depth) == parent for code in codes) > most
    ends = [(prefix + 1) << 3 * (4 - depth) for depth, prefix in zip(depths, prefixes, strict=True)]
    starts = [prefix << 3 * (4 - depth) for depth, prefix in zip(depths, prefixes, strict=True)]
    assert all(end <= start for end, start in zip(ends, starts[1:], strict=False))


def test_a_cube_may_end_where_its_range_does() -> None:
    assert cut_cubes(np.arange(8, dtype=np.uint64), 4, 100, (0, 8**3))[0].tolist() == [1]


def test_duplicates_beyond_a_tile_do_not_loop() -> None:
    """More equal positions than a tile should hold end at the deepest cube instead of splitting for ever."""
    placement = place(np.full((TILE_ANCHORS + 5, 3), 0.5), np.full(TILE_ANCHORS + 5, 0.1))
    assert len(placement.tiles) == 1


def test_far_tiles_are_coarse() -> None:
    """An outlier at 1e4 times the core does not refine the lattice of its own tile."""
    draw = np.random.default_rng(1)
    positions = np.concatenate([draw.random((50_000, 3)), [[1e4, 0, 0]]])
    wanted = np.append(np.full(50_000, 1e-3), 10.0)
    placement = place(positions, wanted)
    shifts = np.array([placement.tiles[t].shift for t in placement.tile])
    assert shifts[-1] > shifts[:-1].max() + 8


def test_what_lies_beyond_all_reach_of_the_rest_is_found() -> None:
    """Not what is far as in real scenes, nor a second half of the scene."""
    scene = np.random.default_rng(0).normal(size=(5000, 3))
    for far in (1e30, -1e9):
        scene[[7, 4000]] = [far, 0, 0], [0, 0, far]
        assert find_far(scene).tolist() == [7, 4000]
    scene[[7, 4000]] = 1e4
    assert len(find_far(scene)) == 0
    scene[:2500, 0] += 1e30
    assert len(find_far(scene)) == 0
    one_place = np.zeros((5000, 3))
    one_place[7] = 1
    assert len(find_far(one_place)) == 0


def test_more_at_one_place_than_a_file_holds_are_refused() -> None:
    scene = np.random.default_rng(0).normal(size=(300, 3))
    scene[::3] = [1, 2, 3]
    check_crowd(scene, 100)
    refuses("input-crowded", lambda: check_crowd(scene, 99), r"100 Gaussians lie at one place \(1, 2, 3\)")
