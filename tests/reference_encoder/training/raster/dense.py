"""The oracle of the rasteriser's tests: every Gaussian at every pixel, in float64, differentiated by torch.

It shares no code with the rasteriser: covariances as matrices, exponents as quadratic forms, gradients by autograd.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from reference_encoder.training.raster import Gaussians
from scarfmt.render.camera import Camera


@dataclass(frozen=True)
class Dense:
    """The result of :func:`render_dense`: (H, W, 3) image, (M, 2) means with a gradient, (M,) weights, and what
    happened.

    Attributes:
        capped: at how many pixels the cap of alpha held.
        closed: how many pixels were closed.
    """

    image: Tensor
    means: Tensor
    weights: Tensor
    capped: int
    closed: int


def _matrices(quaternions: Tensor) -> Tensor:
    w, x, y, z = (quaternions / quaternions.norm(dim=1, keepdim=True)).unbind(1)
    rows = [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)]
    rows += [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)]
    rows += [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]
    return torch.stack(rows, 1).view(-1, 3, 3)


def _covariances(local: Tensor, gaussians: Gaussians, camera: Camera, pose: Tensor) -> Tensor:
    """(M, 2, 2) with the frustum clamp and the camera's dilation."""
    x, y, z = local.unbind(1)
    limit_x, limit_y = 1.3 * camera.width / (2 * camera.fx), 1.3 * camera.height / (2 * camera.fy)
    tx, ty, zero = (x / z).clamp(-limit_x, limit_x) * z, (y / z).clamp(-limit_y, limit_y) * z, torch.zeros_like(z)
    jacobian = [camera.fx / z, zero, -camera.fx * tx / z**2, zero, camera.fy / z, -camera.fy * ty / z**2]
    axes = _matrices(gaussians.rotations) * gaussians.scales[:, None]
    projected = torch.stack(jacobian, 1).view(-1, 2, 3) @ pose[:3, :3] @ axes
    return projected @ projected.transpose(1, 2) + camera.dilation * torch.eye(2, dtype=torch.float64)


def render_dense(gaussians: Gaussians, camera: Camera, background: Tensor) -> Dense:
    """The picture of M Gaussians whose tensors are float64, by INRIA's rules, with a gradient of everything."""
    pose = torch.tensor(camera.world_to_camera, dtype=torch.float64)
    local = gaussians.centres @ pose[:3, :3].T + pose[:3, 3]
    z = torch.where(local[:, 2] > camera.near, local[:, 2], 1.0)
    means = torch.stack([camera.fx * local[:, 0] / z + camera.cx, camera.fy * local[:, 1] / z + camera.cy], 1)
    means.retain_grad()
    ahead = local[:, 2].detach() > camera.near
    covariances = _covariances(torch.where(ahead[:, None], local, 1.0), gaussians, camera, pose)
    conics = torch.linalg.inv(covariances)
    rows, columns = torch.meshgrid(torch.arange(camera.height), torch.arange(camera.width), indexing="ij")
    pixels = torch.stack([columns, rows], -1).double() + 0.5
    image, left = torch.zeros(camera.height, camera.width, 3, dtype=torch.float64), torch.ones(rows.shape).double()
    is_open, weights, capped = torch.ones(rows.shape, dtype=torch.bool), torch.zeros(len(means)), 0
    for i in local[:, 2].detach().float().sort(stable=True).indices:
        if not ahead[i]:
            continue
        offset = pixels - means[i]
        alpha = gaussians.opacities[i] * torch.exp(-0.5 * torch.einsum("hwi,ij,hwj->hw", offset, conics[i], offset))
        capped += int((is_open & (alpha > 0.99)).sum())
        alpha = alpha.clamp_max(0.99)
        shows = is_open & (alpha >= 1 / 255)
        is_open = is_open & ~(shows & (left * (1 - alpha) < 1e-4))
        alpha = torch.where(shows & is_open, alpha, 0.0)
        image = image + (alpha * left)[..., None] * gaussians.colours[i]
        weights[i] = (alpha * left).sum().detach()
        left = left * (1 - alpha)
    return Dense(image + left[..., None] * background, means, weights, capped, int((~is_open).sum()))
