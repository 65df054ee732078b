"""From Gaussians to the ellipses that a camera sees, in torch, with the gradient written out.

The same EWA projection as :mod:`scarfmt.render.projection`, whose constants it takes. An ellipse is kept as a sum of
squares, across (dx - slope dy)^2 + down dy^2, which binary32 bears where the usual conic cancels: in long thin splats.
With the covariance (xx, xy, yy): across = yy / (xx yy - xy^2), slope = xy / yy, down = 1 / yy.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import torch
from torch import Tensor

from reference_encoder.training.raster.gaussians import Gaussians
from scarfmt.render.camera import Camera
from scarfmt.render.projection import FRUSTUM_MARGIN, MIN_ALPHA

_BOUND_SLACK = 2e-3
"""Bounds of an ellipse are widened by so much of a pixel, so that rounding to binary32 never drops a pixel."""


@dataclass(frozen=True)
class Lens:
    """A camera as tensors and numbers. `pose` is (3, 4) float64 on the device of what is drawn."""

    camera: Camera
    pose: Tensor

    @staticmethod
    def of(camera: Camera, like: Tensor) -> Lens:
        """The lens of a camera, on the device of `like`."""
        return Lens(camera, torch.tensor(camera.world_to_camera[:3], dtype=torch.float64, device=like.device))

    @property
    def limits(self) -> tuple[float, float]:
        """Slopes of rays beyond which the projection is that of the limit."""
        camera = self.camera
        return FRUSTUM_MARGIN * camera.width / (2 * camera.fx), FRUSTUM_MARGIN * camera.height / (2 * camera.fy)


def to_camera(centres: Tensor, lens: Lens) -> Tensor:
    """(M, 3) positions with the camera's axes, world units.

    Rounded once, as by the compiled projection: else depths an ulp apart are drawn in another order than there.
    """
    return torch.addmm(lens.pose[:, 3], centres.double(), lens.pose[:, :3].T).to(centres.dtype)


def to_pixels(local: Tensor, lens: Lens) -> Tensor:
    """(M, 2) pixel positions of the centres; of those not in front of the camera, some number."""
    camera = lens.camera
    z = local[:, 2:].detach()
    ahead = torch.where(z > camera.near, local[:, 2:], 1.0)
    scale, shift = local.new_tensor([camera.fx, camera.fy]), local.new_tensor([camera.cx, camera.cy])
    return local[:, :2] / ahead * scale + shift


@dataclass(frozen=True)
class Shapes:
    """S projected Gaussians; numbers of one splat lie in a column.

    Attributes:
        z: (S,) depths, world units.
        slopes: (2, S) x / z and y / z.
        jacobian: (2, 3, S) change of the pixel with the position, pixels per world unit, at clamped slopes.
        rotation: (3, 3, S) rotation matrices.
        turned: (2, 3, S) jacobian times rotation.
        quaternion: (4, S) normalised; length: (S,) what by.
        scales: (3, S).
        normal: (3, S) cross product of the projected axes' rows.
        covariance: (3, S) xx, xy, yy, dilated, pixels^2.
        ellipse: (3, S) across, slope, down.
    """

    z: Tensor
    slopes: Tensor
    jacobian: Tensor
    rotation: Tensor
    turned: Tensor
    quaternion: Tensor
    length: Tensor
    scales: Tensor
    normal: Tensor
    covariance: Tensor
    ellipse: Tensor


def _normalised(quaternions: Tensor) -> tuple[Tensor, Tensor]:
    """(4, S) quaternions of length 1, or 0, and (S,) what they were divided by; squares of tiny ones are not lost."""
    tiny = torch.finfo(quaternions.dtype).tiny
    largest = quaternions.abs().amax(0).clamp_min(tiny)
    scaled = quaternions / largest
    length = (scaled * scaled).sum(0).sqrt().clamp_min(tiny)
    return scaled / length, largest * length


def _rotation(q: Tensor) -> Tensor:
    """(3, 3, S) matrices of (4, S) unit quaternions; a zero one stands for no rotation."""
    w, x, y, z = q
    xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
    wx, wy, wz = w * x, w * y, w * z
    entries = [0.5 - yy - zz, xy - wz, xz + wy, xy + wz, 0.5 - xx - zz, yz - wx, xz - wy, yz + wx, 0.5 - xx - yy]
    return (2 * torch.stack(entries)).view(3, 3, -1)


def shapes(local: Tensor, scales: Tensor, rotations: Tensor, lens: Lens) -> Shapes:
    """Project S Gaussians in front of the camera, given as rows.

    Args:
        local: (S, 3) positions with the camera's axes.
        scales: (S, 3).
        rotations: (S, 4).
        lens: the camera.
    """
    x, y, z = local.T.contiguous()
    slopes = torch.stack([x / z, y / z])
    bound_x, bound_y = lens.limits
    tx, ty = slopes[0].clamp(-bound_x, bound_x), slopes[1].clamp(-bound_y, bound_y)
    rows = lens.pose[:, :3, None].to(z.dtype)
    across_x = lens.camera.fx / z * (rows[0] - tx * rows[2])
    across_y = lens.camera.fy / z * (rows[1] - ty * rows[2])
    quaternion, length = _normalised(rotations.T.contiguous())
    rotation, jacobian = _rotation(quaternion), torch.stack([across_x, across_y])
    turned = (jacobian[:, :, None] * rotation).sum(1)
    deviations = scales.T.contiguous()
    a, b = turned * deviations
    xx, xy, yy = (a * a).sum(0), (a * b).sum(0), (b * b).sum(0)
    # |a x b|^2 is the undilated determinant (Cauchy-Binet), free of the cancellation of xx * yy - xy^2.
    normal, dilation = torch.linalg.cross(a, b, dim=0), lens.camera.dilation
    determinant = (normal * normal).sum(0) + dilation * (xx + yy) + dilation * dilation
    xx, yy = xx + dilation, yy + dilation
    ellipse = torch.stack([yy / determinant, xy / yy, 1 / yy])
    covariance = torch.stack([xx, xy, yy])
    return Shapes(z, slopes, jacobian, rotation, turned, quaternion, length, deviations, normal, covariance, ellipse)


def _to_quaternion(towards: Tensor, found: Shapes) -> Tensor:
    """(4, S) gradient of the unnormalised quaternions, from the (3, 3, S) one of the matrices."""
    (w, x, y, z), g = found.quaternion, towards
    skew_x, skew_y, skew_z = g[2, 1] - g[1, 2], g[0, 2] - g[2, 0], g[1, 0] - g[0, 1]
    both_xy, both_xz, both_yz = g[0, 1] + g[1, 0], g[0, 2] + g[2, 0], g[1, 2] + g[2, 1]
    of_w = x * skew_x + y * skew_y + z * skew_z
    of_x = w * skew_x + y * both_xy + z * both_xz - 2 * x * (g[1, 1] + g[2, 2])
    of_y = w * skew_y + x * both_xy + z * both_yz - 2 * y * (g[0, 0] + g[2, 2])
    of_z = w * skew_z + x * both_xz + y * both_yz - 2 * z * (g[0, 0] + g[1, 1])
    unit = 2 * torch.stack([of_w, of_x, of_y, of_z])
    along = (unit * found.quaternion).sum(0)
    return (unit - along * found.quaternion) / found.length


def shapes_back(towards: Tensor, found: Shapes, lens: Lens) -> tuple[Tensor, Tensor, Tensor]:
    """Gradients of (S, 3) local, (S, 3) scales and (S, 4) rotations, from the (3, S) one of the ellipses.

    With a, b the two rows of the projected axes and e = a - slope b, 1 / across = e e + dilation (1 + slope^2), which
    does not change with the slope to first order. Written in e and b, nothing cancels in long thin Gaussians.
    """
    across, slope, down = found.ellipse
    to_across, to_slope, to_down = towards
    a, b = found.turned * found.scales
    e = down * (torch.linalg.cross(b, found.normal, dim=0) + lens.camera.dilation * a)
    e_turned = e / found.scales.clamp_min(torch.finfo(e.dtype).tiny)
    mixed = down * to_slope
    to_e = mixed * b - 2 * across * across * to_across * e
    to_b = mixed * e - 2 * down * down * to_down * b
    to_scales = to_e * e_turned + to_b * found.turned[1]
    to_e_turned, to_b_turned = to_e * found.scales, to_b * found.scales
    e_jacobian = (found.rotation * e_turned).sum(1)
    to_rotation = e_jacobian[:, None] * to_e_turned + found.jacobian[1][:, None] * to_b_turned
    to_jacobian = (found.rotation * torch.stack([to_e_turned, to_b_turned - slope * to_e_turned])[:, None]).sum(2)
    focal = towards.new_tensor([lens.camera.fx, lens.camera.fy])[:, None] / found.z
    limits = towards.new_tensor(lens.limits)[:, None]
    to_slopes = -focal * (lens.pose[2, :3, None].to(to_jacobian.dtype) * to_jacobian).sum(1)
    to_slopes = torch.where(found.slopes.abs() <= limits, to_slopes, 0.0) / found.z
    to_z = -(to_scales * found.scales).sum(0) / found.z - (to_slopes * found.slopes).sum(0)
    to_local = torch.stack([to_slopes[0], to_slopes[1], to_z], 1)
    return to_local, to_scales.T, _to_quaternion(to_rotation, found).T


@dataclass(frozen=True)
class Seen:
    """The S Gaussians that touch the centre of a pixel, nearest first; of two as near, the first.

    Attributes:
        which: (S,) int64 numbers among the M.
        ellipses: (S, 3) float32 across, slope, down.
        halves: (S, 2) float32 half extents, pixels.
        half_row: (S,) float32 half extent in the row of the mean, pixels.
    """

    which: Tensor
    ellipses: Tensor
    halves: Tensor
    half_row: Tensor


def _nearby(local: Tensor, means: Tensor, gaussians: Gaussians, reach: Tensor, lens: Lens) -> Tensor:
    """(V,) int64 rising: which Gaussians may touch the picture, by the largest circle that they could show as."""
    camera = lens.camera
    z, largest = local[:, 2], gaussians.scales.amax(1)
    bound_x, bound_y = lens.limits
    widest = max(camera.fx**2 * (1 + bound_x**2), camera.fy**2 * (1 + bound_y**2))
    radius = torch.sqrt(reach * (widest * (largest / z).square() + camera.dilation)) + _BOUND_SLACK
    beyond = (means - means.new_tensor([camera.width / 2, camera.height / 2])).abs()
    beyond = (beyond - means.new_tensor([camera.width / 2, camera.height / 2])).amax(1)
    # Written so that a NaN is left out too.
    near = (z > camera.near) & (z < torch.inf) & (reach >= 0) & (beyond <= radius)
    return near.nonzero()[:, 0]


def _touches(means: Tensor, halves: Tensor, lens: Lens) -> Tensor:
    """(V,) bool: whether the centre of some pixel of the picture lies within `halves` of `means`, both (V, 2)."""
    last = means.new_tensor([lens.camera.width - 1, lens.camera.height - 1])
    first_pixel = (means - halves - 0.5).ceil().clamp_min(0)
    last_pixel = torch.minimum((means + halves - 0.5).floor(), last)
    return (first_pixel <= last_pixel).all(1)


@torch.no_grad()
def see(local: Tensor, means: Tensor, gaussians: Gaussians, lens: Lens) -> Seen:
    """The Gaussians that are visible, and their ellipses.

    Args:
        local: (M, 3) positions with the camera's axes.
        means: (M, 2) pixels.
        gaussians: the M Gaussians.
        lens: the camera.
    """
    reach = 2 * torch.log(gaussians.opacities / MIN_ALPHA)
    index = _nearby(local, means, gaussians, reach, lens)
    found = shapes(local[index], gaussians.scales[index], gaussians.rotations[index], lens)
    reach, near_means = reach[index], means[index]
    halves = torch.sqrt(reach * found.covariance[::2]).T + _BOUND_SLACK
    touching = (_touches(near_means, halves, lens) & (found.ellipse[0] > 0)).nonzero()[:, 0]
    # Positive floats order like their bits, and whole numbers are sorted by digits.
    order = touching[found.z[touching].view(torch.int32).sort(stable=True).indices]
    half_row = torch.sqrt(reach[order] / found.ellipse[0, order])
    return Seen(index[order], found.ellipse[:, order].T.contiguous(), halves[order], half_row)


class _Ellipses(torch.autograd.Function):
    """The ellipses of :func:`see` as a function of what they come from."""

    @staticmethod
    def forward(ctx: Any, local: Tensor, scales: Tensor, rotations: Tensor, seen: Seen, lens: Lens) -> Tensor:
        ctx.save_for_backward(local, scales, rotations)
        ctx.seen, ctx.lens = seen, lens
        return seen.ellipses

    @staticmethod
    def backward(ctx: Any, towards: Tensor) -> tuple[Tensor, Tensor, Tensor, None, None]:
        which, inputs = ctx.seen.which, ctx.saved_tensors
        local, scales, rotations = (one[which] for one in inputs)
        found = shapes(local, scales, rotations, ctx.lens)
        gradients = [torch.zeros_like(one) for one in inputs]
        for whole, part in zip(gradients, shapes_back(towards.T.contiguous(), found, ctx.lens), strict=True):
            whole[which] = part
        return gradients[0], gradients[1], gradients[2], None, None


def ellipses(local: Tensor, gaussians: Gaussians, seen: Seen, lens: Lens) -> Tensor:
    """(S, 3) across, slope, down of what is seen, with a gradient."""
    inputs = local, gaussians.scales, gaussians.rotations
    return cast(Tensor, _Ellipses.apply(*inputs, seen, lens))  # type: ignore[no-untyped-call]
