"""Learning a hash grid: the features trained on are those decoded, and the bits learn what pays."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from reference_encoder.training.networks.grid import BinaryGrid, fit_box, hybrid_levels, wave_grid
from scarfmt.blocks.hash_grid import pack_grid
from scarfmt.neural.grid import FEATURE_MAX, GridBox, GridLevel, check_grid

BOX = GridBox((100, 0, 40), 9)
LEVELS = (GridLevel(0, 6, 9, 3), GridLevel(0, 33, 8, 4), GridLevel(2, 20, 9, 2), GridLevel(5, 16, 5, 1))


def positions(count: int) -> NDArray[np.int64]:
    """Inside the box and round it."""
    return np.random.default_rng(2).integers(0, 700, (count, 3))


def test_features_are_those_of_the_exported_grid() -> None:
    """Exactly, for a sample of what was looked up."""
    module = BinaryGrid(BOX, LEVELS, seed=4)
    at, chosen = positions(500), torch.arange(3, 500, 7)
    lookup = module.lookup(at)
    found = module([(a[chosen], w[chosen]) for a, w in lookup]).detach().numpy()
    assert np.array_equal(found, module.export().features(at[chosen.numpy()]))
    check_grid(module.box, module.levels)


def test_features_reach_both_ends() -> None:
    """If all bits agree the sum is +-2^24 in 3D: there is no rounding error, and it is clamped to +-127."""
    for sign in (-1.0, 1.0):
        module = BinaryGrid(BOX, LEVELS)
        with torch.no_grad():
            for table in module.tables:
                table.fill_(sign)
        assert module(module.lookup(positions(200))).unique().tolist() == [sign * FEATURE_MAX]


def test_gradients_are_the_interpolation_weights() -> None:
    """The gradient with respect to an entry is its interpolation weight while the parameter is within -1..1, and 0
    beyond."""
    module = BinaryGrid(BOX, LEVELS[1:2])
    with torch.no_grad():
        module.tables[0][:, 1] = 1.5
    lookup = module.lookup(positions(1))
    module(lookup)[0, :2].sum().backward()
    gradient = module.tables[0].grad
    wanted = torch.zeros(256).index_add_(0, lookup[0][0][0].long(), lookup[0][1][0] / 2**17)
    assert torch.allclose(gradient[:, 0], wanted)
    assert float(wanted.sum()) == pytest.approx(128.0)
    assert not gradient[:, 1:].any()


@pytest.mark.parametrize("share", [0.0, 0.03, 0.5, 0.8, 1.0])
def test_coded_bits_are_those_of_the_block(share: float) -> None:
    """To what headers and the ends of streams take."""
    module = BinaryGrid(BOX, (GridLevel(0, 60, 14, 4), GridLevel(1, 90, 13, 2)))
    generator = torch.Generator().manual_seed(1)
    with torch.no_grad():
        for table in module.tables:
            table.copy_(share - torch.rand(table.shape, generator=generator))
    assert abs(8 * len(pack_grid(module.export())) - module.coded_bits().item()) < 8 * 50


def test_the_rate_pushes_bits_towards_the_commoner_one() -> None:
    """By what a one costs more than a zero; a bit that carries nothing then joins the majority."""
    module = BinaryGrid(BOX, LEVELS[1:2])
    with torch.no_grad():
        module.tables[0].fill_(-0.05)
        module.tables[0][:64].fill_(0.05)
    module.coded_bits().backward()  # type: ignore[no-untyped-call]
    gradient = module.tables[0].grad
    assert torch.allclose(gradient, torch.full_like(gradient, np.log2(3.0) / 2))


def test_outliers_do_not_take_resolution() -> None:
    """Half a per cent of anchors a million steps away leave the box where the others are."""
    rng = np.random.default_rng(0)
    at = rng.integers(5000, 6000, (4000, 3))
    at[:20] = 1 << 30
    box, extent = fit_box(at)
    assert box.extent_bits == 10
    assert all(4900 <= origin <= 5100 for origin in box.origin)
    assert extent == pytest.approx((0.96, 0.96, 0.96), abs=0.03)


@pytest.mark.parametrize("point", [0, 7, 2**32 - 1])
def test_one_anchor_has_a_box(point: int) -> None:
    """The box holds one lattice point, wherever it is."""
    assert fit_box(np.full((1, 3), point)) == (GridBox((point, point, point), 0), (1.0, 1.0, 1.0))


@pytest.mark.parametrize("count", [1, 500, 150_000, 50_000_000])
def test_levels_are_valid_and_grow_with_the_scene(count: int) -> None:
    """From one anchor to the largest scene, flat or not; but never more than a bit an anchor of a large scene."""
    for extent in ((1.0, 1.0, 1.0), (0.6, 0.3, 0.4), (1.0, 1e-4, 1e-4)):
        levels = hybrid_levels(count, extent)
        grid = BinaryGrid(BOX, levels).export()
        check_grid(grid.box, grid.levels)
        assert {level.plane for level in levels} == set(range(7))
        assert sum(level.bits for level in levels) <= max(count, 4096)


def test_waves_tell_places_apart() -> None:
    """Every one of 64 places along an axis has features of its own, from far fewer bits than a network's."""
    grid = wave_grid(GridBox((0, 0, 0), 8))
    check_grid(grid.box, grid.levels)
    at = np.zeros((64, 3), np.int64)
    at[:, 1] = np.arange(0, 256, 4)
    features = grid.features(at)
    assert len(np.unique(features, axis=0)) == 64
    assert (features == features[0]).all(axis=0).sum() == 2 * grid.width // 3
    assert len(pack_grid(grid)) < 400
