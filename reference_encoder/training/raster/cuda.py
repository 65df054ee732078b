"""Pictures of Gaussians on a CUDA device: torch projects, sorts and lists, Triton blends (:mod:`.triton_kernels`).

The same EWA projection as :mod:`scarfmt.render.projection`, whose constants it takes, in binary64, which bears what
cancels in long thin splats. An ellipse is kept as a sum of squares, across (dx - slope dy)^2 + down dy^2, which bears
binary32 where the usual conic cancels. With the covariance (xx, xy, yy): across = yy / (xx yy - xy^2),
slope = xy / yy, down = 1 / yy.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import torch
from torch import Tensor

from reference_encoder.training.raster.compiled import Gaussians, Listing, sum_by_splat
from scarfmt.errors import missing_package
from scarfmt.render.camera import Camera
from scarfmt.render.native.binding import FRUSTUM_MARGIN, GRADIENTS, MAX_ALPHA, MIN_ALPHA, MIN_TRANSMITTANCE, TILE

_BOUND_SLACK = 2e-3
"""Bounds of an ellipse are widened by so much of a pixel, so that rounding to binary32 never drops a pixel."""


@dataclass(frozen=True)
class VisibleSplats:
    """The S of M Gaussians that touch the centre of a pixel, nearest first; of two as near, the first.

    Attributes:
        means: (M, 2) float32 pixel positions of all centres, with a gradient; of those not in front of the camera, some
            number.
        which: (S,) int64 numbers among the M.
        ellipses: (S, 3) float32 across, slope, down, with a gradient.
        halves: (S, 2) float32 half extents, pixels.
        half_row: (S,) float32 half extent in the row of the mean, pixels.
    """

    means: Tensor
    which: Tensor
    ellipses: Tensor
    halves: Tensor
    half_row: Tensor


def project(gaussians: Gaussians, camera: Camera) -> VisibleSplats:
    """Project M Gaussians, and find those that are visible."""
    pose = torch.tensor(camera.world_to_camera[:3], dtype=torch.float64, device=gaussians.centres.device)
    local = torch.addmm(pose[:, 3], gaussians.centres.double(), pose[:, :3].T)
    # Rounded once, as by the compiled projection: else depths an ulp apart are drawn in another order than there.
    depths = local[:, 2].detach().float()
    ahead = torch.where(depths > camera.near, local[:, 2], 1.0)[:, None]
    focal, middle = local.new_tensor([camera.fx, camera.fy]), local.new_tensor([camera.cx, camera.cy])
    means = (local[:, :2] / ahead * focal + middle).float()
    reach = 2 * torch.log(gaussians.opacities.detach() / MIN_ALPHA)
    near = _nearby(depths, means.detach(), gaussians.scales.detach(), reach, camera)
    own = [part.index_select(0, near) for part in (local, gaussians.scales, gaussians.rotations)]
    xx, xy, yy = _covariance(own[0], own[1].double(), own[2].double(), pose, camera)
    ellipses = torch.stack([yy / (xx * yy - xy * xy), xy / yy, 1 / yy], 1)
    reach, near_means = reach[near], means.detach()[near]
    halves = torch.sqrt(reach[:, None] * torch.stack([xx, yy], 1).detach().float()) + _BOUND_SLACK
    touching = (_touches(near_means, halves, camera) & (ellipses[:, 0] > 0)).nonzero()[:, 0]
    # Positive floats order like their bits, and whole numbers are sorted by digits.
    order = touching[depths[near][touching].view(torch.int32).sort(stable=True).indices]
    shown = ellipses.index_select(0, order).float()
    half_row = torch.sqrt(reach[order] / shown.detach()[:, 0])
    return VisibleSplats(means, near[order], shown, halves[order], half_row)


def _limits(camera: Camera) -> tuple[float, float]:
    """Slopes of rays beyond which the projection is that of the limit."""
    return FRUSTUM_MARGIN * camera.width / (2 * camera.fx), FRUSTUM_MARGIN * camera.height / (2 * camera.fy)


def _covariance(local: Tensor, scales: Tensor, rotations: Tensor, pose: Tensor, camera: Camera) -> Tensor:
    """(3, V) float64 xx, xy, yy, dilated, pixels^2, of V Gaussians in front of the camera.

    Args:
        local: (V, 3) positions with the camera's axes; `scales`: (V, 3); `rotations`: (V, 4); all float64.
        pose: (3, 4) of the camera.
    """
    slopes = (local[:, :2] / local[:, 2:]).T
    limit_x, limit_y = _limits(camera)
    tx, ty = slopes[0].clamp(-limit_x, limit_x)[:, None], slopes[1].clamp(-limit_y, limit_y)[:, None]
    right, down, forward = pose[:, :3]
    rows = torch.stack([camera.fx * (right - tx * forward), camera.fy * (down - ty * forward)], 1)
    w, x, y, z = (rotations * (rotations * rotations).sum(1, keepdim=True).clamp_min(1e-200).rsqrt()).unbind(1)
    # A zero quaternion stands for no rotation.
    entries = [0.5 - y * y - z * z, x * y - w * z, x * z + w * y]
    entries += [x * y + w * z, 0.5 - x * x - z * z, y * z - w * x]
    entries += [x * z - w * y, y * z + w * x, 0.5 - x * x - y * y]
    matrices = 2 * torch.stack(entries, 1).view(-1, 3, 3)
    a, b = (rows / local[:, 2:, None] @ matrices * scales[:, None]).unbind(1)
    xx, xy, yy = (a * a).sum(1), (a * b).sum(1), (b * b).sum(1)
    return torch.stack([xx + camera.dilation, xy, yy + camera.dilation])


def _nearby(depths: Tensor, means: Tensor, scales: Tensor, reach: Tensor, camera: Camera) -> Tensor:
    """(V,) int64 rising: which Gaussians may touch the picture, by the largest circle that they could show as."""
    limit_x, limit_y = _limits(camera)
    widest = max(camera.fx**2 * (1 + limit_x**2), camera.fy**2 * (1 + limit_y**2))
    radius = torch.sqrt(reach * (widest * (scales.amax(1) / depths).square() + camera.dilation)) + _BOUND_SLACK
    halves = means.new_tensor([camera.width / 2, camera.height / 2])
    beyond = ((means - halves).abs() - halves).amax(1)
    # Written so that a NaN is left out too.
    near = (depths > camera.near) & (depths < torch.inf) & (reach >= 0) & (beyond <= radius)
    return near.nonzero()[:, 0]


def _touches(means: Tensor, halves: Tensor, camera: Camera) -> Tensor:
    """(V,) bool: whether the centre of some pixel of the picture lies within `halves` of `means`, both (V, 2)."""
    last = means.new_tensor([camera.width - 1, camera.height - 1])
    first_pixel = (means - halves - 0.5).ceil().clamp_min(0)
    last_pixel = torch.minimum((means + halves - 0.5).floor(), last)
    return (first_pixel <= last_pixel).all(1)


def list_tiles(means: Tensor, halves: Tensor, camera: Camera) -> Listing:
    """List the tiles with pixel centres in the bounds of S splats, each of which touches one.

    Args:
        means: (S, 2) float32 pixels, without gradient.
        halves: (S, 2) float32 half extents, pixels.
    """
    columns, rows = -(-camera.width // TILE), -(-camera.height // TILE)
    last = means.new_tensor([camera.width - 1, camera.height - 1])
    first_tile = (means - halves - 0.5).ceil().clamp_min(0).int() // TILE
    past_tile = torch.minimum((means + halves - 0.5).floor(), last).int() // TILE + 1
    wide, high = (past_tile - first_tile).unbind(1)
    counts = wide * high
    starts = torch.zeros(len(means) + 1, dtype=torch.int64, device=means.device)
    torch.cumsum(counts, 0, out=starts[1:])
    splats = torch.arange(len(means), dtype=torch.int32, device=means.device)
    owners = torch.repeat_interleave(splats, counts)
    within = torch.arange(len(owners), dtype=torch.int32, device=means.device) - starts.int()[owners]
    wide_here = wide[owners]
    row = torch.div(within, wide_here, rounding_mode="floor")
    corner = first_tile[:, 1] * columns + first_tile[:, 0]
    tiles = corner[owners] + row * (columns - wide_here) + within
    sorted_tiles, listed = tiles.sort(stable=True)
    numbers = torch.arange(columns * rows + 1, dtype=torch.int32, device=means.device)
    return Listing(columns, torch.searchsorted(sorted_tiles, numbers), listed.int(), owners[listed], starts)


@dataclass(frozen=True)
class _View:
    """The blended splats: their Gaussians, rows as `Splat` of raster.h, tiles and picture."""

    which: Tensor
    splats: Tensor
    listing: Listing
    camera: Camera

    @property
    def grid(self) -> tuple[int]:
        """A program a tile."""
        return (len(self.listing.offsets) - 1,)

    def lists(self) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """The first arguments of both kernels."""
        return self.splats, self.listing.offsets, self.listing.listed, self.listing.owners

    def rules(self) -> tuple[int, int, int, float, float, float, int]:
        """The last arguments of both kernels."""
        size = self.camera.width, self.camera.height, self.listing.columns
        return *size, MAX_ALPHA, MIN_ALPHA, MIN_TRANSMITTANCE, TILE


def kernels() -> Any:
    """The module of the kernels.

    Raises:
        InvalidInput: ``input-dependency`` where Triton is not installed.
    """
    try:
        from reference_encoder.training.raster import triton_kernels
    except ImportError as error:
        raise missing_package("triton", "cuda") from error
    return triton_kernels


class _Composite(torch.autograd.Function):
    """Picture and (S, 1) weights as functions of what the splats were made of."""

    @staticmethod
    def forward(
        ctx: Any,
        means: Tensor,
        shapes: Tensor,
        opacities: Tensor,
        colours: Tensor,
        background: Tensor,
        view: _View,
    ) -> tuple[Tensor, Tensor]:
        height, width = view.camera.height, view.camera.width
        image, left = means.new_empty(height, width, 3), means.new_empty(height, width)
        parts = means.new_zeros(len(view.listing.listed), 1)
        drawn = torch.empty(view.grid, dtype=torch.int32, device=means.device)
        kernels().blend[view.grid](*view.lists(), background, image, left, parts, drawn, *view.rules())
        ctx.save_for_backward(opacities, background, image)
        ctx.state, ctx.count = (left, drawn, view), len(means)
        weights = sum_by_splat(parts, view.listing)
        ctx.mark_non_differentiable(weights)
        return image, weights

    @staticmethod
    def backward(ctx: Any, towards: Tensor, _: Tensor) -> tuple[Tensor | None, ...]:
        opacities, _, image = ctx.saved_tensors
        left, drawn, view = ctx.state
        towards, which = towards.contiguous(), view.which
        parts = towards.new_zeros(len(view.listing.listed), GRADIENTS)
        kernels().unblend[view.grid](*view.lists(), image, towards, drawn, parts, *view.rules())
        to_shapes, *others = _of_splats(sum_by_splat(parts, view.listing), view.splats[:, 2:5], opacities[which])
        to_means, to_opacities, to_colours = (
            part.new_zeros(ctx.count, *part.shape[1:]).index_copy_(0, which, part) for part in others
        )
        to_background = (towards * left[..., None]).sum((0, 1)) if ctx.needs_input_grad[4] else None
        return to_means, to_shapes, to_opacities, to_colours, to_background, None


def _of_splats(sums: Tensor, shapes: Tensor, opacities: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Gradients of ellipses, means, opacities and colours, from the (S, 9) sums that composite_tiles.h describes."""
    whole, u, u_dy, u_u, dy, dy_dy = sums[:, 3:].unbind(1)
    across, slope, down = shapes.unbind(1)
    to_shapes = torch.stack([-0.5 * u_u, across * u_dy, -0.5 * dy_dy], 1)
    along = across * u
    to_means = torch.stack([along, down * dy - slope * along], 1)
    return to_shapes, to_means, whole / opacities, sums[:, :3]


def draw(gaussians: Gaussians, camera: Camera, background: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """The (H, W, 3) picture of M Gaussians, their (M, 2) means, (S,) which are seen, and the (S,) sums of alpha times
    transmittance of these.

    Args:
        background: (3,) colour behind everything.

    Raises:
        InvalidInput: ``input-dependency`` where Triton is not installed.
    """
    seen = project(gaussians, camera)
    which = seen.which
    centres, ellipses = seen.means.detach()[which], seen.ellipses.detach()
    shades = gaussians.opacities.detach()[which, None].log2(), gaussians.colours.detach()[which]
    splats = torch.cat([centres, ellipses, seen.half_row[:, None], seen.halves, *shades], 1)
    view = _View(which, splats, list_tiles(centres, seen.halves, camera), camera)
    inputs = seen.means, seen.ellipses, gaussians.opacities, gaussians.colours, background
    image, weights = cast(tuple[Tensor, Tensor], _Composite.apply(*inputs, view))  # type: ignore[no-untyped-call]
    return image, seen.means, which, weights[:, 0]
