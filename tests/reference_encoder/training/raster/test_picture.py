"""The rasteriser draws what the measuring renderer draws, and its gradients are those of dense float64 autograd."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
import torch
from torch import Tensor

from reference_encoder.training.raster import Gaussians, Picture, rasterise
from scarfmt.render.camera import Camera

from .dense import Dense, render_dense
from .scenes import SCENES, leaves, mixed, stacked, turned_camera

BACKGROUND = torch.tensor([0.3, 0.6, 1.0])
TOLERANCE = 1e-4
HARD = [(name, seed) for name in SCENES for seed in range(3)]


def towards(camera: Camera) -> Tensor:
    """Some gradient of the picture, of both signs."""
    return torch.randn(camera.height, camera.width, 3, generator=torch.Generator().manual_seed(5))


def both(scene: Gaussians, camera: Camera) -> tuple[tuple[Gaussians, Tensor, Picture], tuple[Gaussians, Tensor, Dense]]:
    """Inputs, background and result of the rasteriser and of the oracle, after a backward pass."""
    here, there = leaves(scene, torch.float32), leaves(scene, torch.float64)
    background, background64 = BACKGROUND.clone().requires_grad_(), BACKGROUND.double().requires_grad_()
    picture, dense = rasterise(here, camera, background), render_dense(there, camera, background64)
    (picture.image * towards(camera)).sum().backward()
    (dense.image * towards(camera).double()).sum().backward()
    return (here, background, picture), (there, background64, dense)


def error(found: Tensor | None, expected: Tensor | None) -> float:
    """The largest difference, relative to the largest of what is expected."""
    assert torch.isfinite(found).all()
    return float((found.double() - expected).abs().max() / expected.abs().max())


@pytest.mark.parametrize(("name", "seed"), HARD)
def test_gradients_of_every_input_are_those_of_dense_autograd(name: str, seed: int) -> None:
    (here, background, picture), (there, background64, dense) = both(SCENES[name](seed), turned_camera(40, 35))
    assert float((picture.image - dense.image).detach().abs().max()) < TOLERANCE
    for field in fields(Gaussians):
        found, expected = getattr(here, field.name).grad, getattr(there, field.name).grad
        assert error(found, expected) < TOLERANCE, field.name
    assert error(background.grad, background64.grad) < TOLERANCE
    assert error(picture.means.grad, dense.means.grad) < TOLERANCE
    torch.testing.assert_close(picture.weights, dense.weights, rtol=1e-4, atol=1e-4)
    assert not (dense.weights[~picture.shown] > 0).any()


def test_the_hard_scenes_are_hard() -> None:
    """Caps hold, pixels close, Gaussians are behind the near plane and beside the picture, quaternions are no units."""
    dense = render_dense(leaves(stacked(0), torch.float64), turned_camera(), BACKGROUND.double())
    assert dense.capped > 20
    assert dense.closed > 100
    picture = rasterise(mixed(0), turned_camera(), BACKGROUND)
    assert 5 < int(picture.shown.sum()) < 45


def test_the_same_bits_whatever_the_number_of_threads() -> None:
    scene, camera, threads = mixed(3, 2000), turned_camera(100, 70), torch.get_num_threads()
    found = []
    try:
        for count in (1, 2, 3):
            torch.set_num_threads(count)
            here = leaves(scene, torch.float32)
            picture = rasterise(here, camera, BACKGROUND)
            (picture.image * towards(camera)).sum().backward()
            found.append([picture.image, picture.weights, *(getattr(here, one.name).grad for one in fields(Gaussians))])
    finally:
        torch.set_num_threads(threads)
    for other in found[1:]:
        assert all(torch.equal(one, two) for one, two in zip(found[0], other, strict=True))


def test_nothing_in_the_picture_shows_the_background() -> None:
    """Gaussians behind the camera, and none at all."""
    behind = replace(mixed(0), centres=torch.full((50, 3), -9.0))
    for scene in (behind, Gaussians(*(one[:0] for one in behind.tensors()))):
        here = leaves(scene, torch.float32)
        picture = rasterise(here, turned_camera(), BACKGROUND)
        assert torch.equal(picture.image, BACKGROUND.expand(32, 32, 3))
        assert not picture.shown.any()
        picture.image.sum().backward()
        assert all(not getattr(here, one.name).grad.any() for one in fields(Gaussians))


def test_values_that_are_not_numbers_are_not_drawn() -> None:
    """A run that diverges shows in its loss, not as a crash."""
    scene = mixed(1)
    for one in (scene.centres, scene.scales, scene.rotations):
        one[:6] = torch.tensor([np.nan, np.inf, -np.inf]).repeat(2)[:, None]
    picture = rasterise(scene, turned_camera(), BACKGROUND)
    assert torch.isfinite(picture.image).all()
    assert not picture.shown[:6].any()
