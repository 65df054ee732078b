"""Torch projects and lists as the compiled library does: other devices draw the same picture."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from reference_encoder.training.raster.compiled import Gaussians, Prepared, prepare
from reference_encoder.training.raster.cuda import VisibleSplats, list_tiles, project

from .scenes import SCENES, leaves, mixed, turned_camera

CAMERA = turned_camera(70, 50)


def both(scene: Gaussians) -> tuple[Prepared, Gaussians, VisibleSplats]:
    """The library's preparation; and Gaussians with gradients, and torch's projection of them."""
    here = leaves(scene, torch.float32)
    return prepare(leaves(scene, torch.float32), CAMERA), here, project(here, CAMERA)


@pytest.mark.parametrize("name", SCENES)
def test_the_same_ellipses_in_the_same_order(name: str) -> None:
    prepared, _, seen = both(SCENES[name](0))
    assert torch.equal(prepared.which, seen.which)
    torch.testing.assert_close(prepared.means[seen.which], seen.means[seen.which], rtol=1e-5, atol=1e-4)
    torch.testing.assert_close(prepared.ellipses, seen.ellipses, rtol=2e-4, atol=1e-6)
    torch.testing.assert_close(prepared.splats[:, 5], seen.half_row, rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(prepared.splats[:, 6:8], seen.halves, rtol=1e-4, atol=1e-4)


def test_depths_that_an_ulp_parts_are_in_the_same_order() -> None:
    """Slots of an anchor start at one place: of what lies so close, one order is as good, if all devices have it."""
    scene, forward = mixed(0, 2000), torch.tensor(CAMERA.world_to_camera[2])
    depths = scene.centres.double() @ forward[:3] + forward[3]
    flat = scene.centres + (3 - depths.float())[:, None] * forward[:3].float()
    prepared, _, seen = both(replace(scene, centres=flat))
    assert len(seen.which) > 100
    assert torch.equal(prepared.which, seen.which)


@pytest.mark.parametrize("name", SCENES)
def test_the_same_gradients(name: str) -> None:
    scene = SCENES[name](0)
    _, here, seen = both(scene)
    means, shapes = seen.means, seen.ellipses
    other = leaves(scene, torch.float32)
    prepared = prepare(other, CAMERA)
    generator = torch.Generator().manual_seed(1)
    to_shapes, to_means = torch.randn(shapes.shape, generator=generator), torch.zeros(means.shape)
    to_means[seen.which] = torch.randn(len(shapes), 2, generator=generator)
    torch.autograd.backward([means, shapes], [to_means, to_shapes])
    torch.autograd.backward([prepared.means, prepared.ellipses], [to_means, to_shapes])
    for one, two in ((here.centres, other.centres), (here.scales, other.scales), (here.rotations, other.rotations)):
        assert float((one.grad - two.grad).abs().max() / one.grad.abs().max()) < 1e-4


def test_the_same_tiles() -> None:
    """Equal splats give equal lists: these depend on whole numbers."""
    prepared = prepare(mixed(0, 500), CAMERA)
    listing, expected = list_tiles(prepared.splats[:, :2], prepared.splats[:, 6:8], CAMERA), prepared.listing
    assert torch.equal(listing.offsets, expected.offsets)
    assert torch.equal(listing.starts, expected.starts)
    assert torch.equal(listing.listed, expected.listed)
    assert torch.equal(listing.owners, expected.owners)
