"""Small made-up scenes for the rasteriser's tests, each with what is hard about it."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import torch
from torch import Tensor

from reference_encoder.training.raster import Gaussians
from scarfmt.render.camera import Camera


def turned_camera(width: int = 32, height: int = 32) -> Camera:
    """An off-centre camera, a little turned."""
    angle, pose = 0.15, np.eye(4)
    pose[:3, :3] = [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    pose[:3, 3] = [0.1, -0.2, 0.3]
    return Camera(width, height, 0.9 * width, 0.95 * width, 0.52 * width, 0.47 * height, pose)


def mixed(seed: int, count: int = 50) -> Gaussians:
    """Overlapping Gaussians of all sizes and lengths of quaternions, some behind the camera or beside the picture."""
    g = torch.Generator().manual_seed(seed)

    def uniform(low: float, high: float, *shape: int) -> Tensor:
        return low + (high - low) * torch.rand(*shape, generator=g)

    centres = torch.cat([uniform(-2, 2, count, 2), uniform(-0.5, 6, count, 1)], 1)
    rotations = torch.randn(count, 4, generator=g) * uniform(0.1, 9, count, 1)
    opacities = torch.sigmoid(uniform(-6, 6, count))
    return Gaussians(centres, uniform(-4.5, -0.3, count, 3).exp(), rotations, opacities, uniform(0, 1, count, 3))


def stacked(seed: int) -> Gaussians:
    """Large opaque Gaussians one behind the other: alphas reach the cap, and pixels close."""
    scene = mixed(seed)
    scene.centres[:, 2].clamp_min_(1.0)
    scene.opacities[:] = 1.0
    scene.opacities[::3] = 0.7
    return replace(scene, scales=scene.scales.clamp_min(0.3) * 2)


def at_the_near_plane(seed: int) -> Gaussians:
    """Gaussians just before and just behind the near plane, where they are widest, and beside the frustum's margin."""
    scene, camera = mixed(seed), turned_camera()
    depth = torch.linspace(camera.near - 0.1, camera.near + 0.1, 50)
    local = torch.cat([scene.centres[:, :2] * depth[:, None], depth[:, None]], 1).double()
    pose = torch.tensor(camera.world_to_camera)
    scene.centres[:] = ((local - pose[:3, 3]) @ pose[:3, :3]).float()
    return replace(scene, scales=scene.scales * 0.2)


def needles(seed: int) -> Gaussians:
    """Long and thin Gaussians across the whole picture, in all directions."""
    scene = mixed(seed)
    scene.centres[:, 2].clamp_min_(1.0)
    scene.scales[:, 0], scene.scales[:, 1:] = 20.0, 1e-3
    return scene


def tied(seed: int) -> Gaussians:
    """Coincident Gaussians, which are drawn in their order."""
    scene = mixed(seed)
    scene.centres[25:] = scene.centres[:25]
    return scene


SCENES = {"mixed": mixed, "stacked": stacked, "near": at_the_near_plane, "needles": needles, "tied": tied}


def leaves(scene: Gaussians, dtype: torch.dtype) -> Gaussians:
    """Copies of the tensors, with gradients."""
    return Gaussians(*(getattr(scene, one.name).to(dtype).clone().requires_grad_() for one in fields(Gaussians)))
