"""Tiles are disjoint cubes of bounded size, and cell plus residual is the position."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from reference_encoder.lattice import TILE_ANCHORS, Placement, place
from scarfmt.limits import MAX_LOCAL_BITS
from scarfmt.morton import deinterleave


def rebuilt(placement: Placement) -> np.ndarray:
    """Positions by SPEC §9.1 from cells and residuals."""
    lattice = placement.lattice
    tiles = [placement.tiles[t] for t in placement.tile]
    depth = np.array([tile.depth for tile in tiles])
    cell = 2.0 ** np.array([tile.shift for tile in tiles])[:, None]
    corner = deinterleave(np.array([tile.prefix for tile in tiles], np.uint64)) * 2.0 ** (lattice.bits - depth)[:, None]
    local = deinterleave(placement.codes) * cell
    return np.array(lattice.origin) + lattice.voxel * (corner + local + cell / 2 + cell * placement.residual)


@settings(max_examples=60, deadline=None)
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


def test_large_clouds_are_split() -> None:
    """No tile holds more than `TILE_ANCHORS` anchors while cubes can still be halved."""
    positions = np.random.default_rng(0).random((3 * TILE_ANCHORS, 3))
    placement = place(positions, np.full(len(positions), 0.01))
    assert len(placement.tiles) >= 8
    assert np.bincount(placement.tile).max() <= TILE_ANCHORS


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
