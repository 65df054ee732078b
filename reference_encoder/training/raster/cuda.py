"""Pictures of Gaussians on a CUDA device: torch projects, sorts and lists, Triton blends (:mod:`.triton_kernels`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import torch
from torch import Tensor

from reference_encoder.training.raster.binning import Listing, list_tiles
from reference_encoder.training.raster.gaussians import Gaussians
from reference_encoder.training.raster.loading import GRADIENTS, TILE
from reference_encoder.training.raster.projection import Lens, Seen, ellipses, see, to_camera, to_pixels
from scarfmt.errors import missing_package
from scarfmt.render.camera import Camera
from scarfmt.render.projection import MAX_ALPHA, MIN_ALPHA, MIN_TRANSMITTANCE


@dataclass(frozen=True)
class _View:
    """The blended splats: rows as `Splat` of raster.h, their Gaussians, tiles and picture."""

    seen: Seen
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
        weights = _by_splat(parts, view.listing)
        ctx.mark_non_differentiable(weights)
        return image, weights

    @staticmethod
    def backward(ctx: Any, towards: Tensor, _: Tensor) -> tuple[Tensor | None, ...]:
        opacities, _, image = ctx.saved_tensors
        left, drawn, view = ctx.state
        towards, which = towards.contiguous(), view.seen.which
        parts = towards.new_zeros(len(view.listing.listed), GRADIENTS)
        kernels().unblend[view.grid](*view.lists(), image, towards, drawn, parts, *view.rules())
        sums = _of_splats(_by_splat(parts, view.listing), view.seen.ellipses, opacities[which])
        to_shapes, *others = sums
        to_means, to_opacities, to_colours = (
            part.new_zeros(ctx.count, *part.shape[1:]).index_copy_(0, which, part) for part in others
        )
        to_background = (towards * left[..., None]).sum((0, 1)) if ctx.needs_input_grad[4] else None
        return to_means, to_shapes, to_opacities, to_colours, to_background, None


def _by_splat(rows: Tensor, listing: Listing) -> Tensor:
    """(S, wide) sums of the (I, wide) rows of each splat, in the order of their numbers."""
    if len(rows) == 0:
        return rows.new_zeros(len(listing.starts) - 1, rows.shape[1])
    sums: Tensor = torch.segment_reduce(rows, "sum", lengths=listing.starts.diff(), axis=0, initial=0)
    return sums


def _of_splats(sums: Tensor, shapes: Tensor, opacities: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Gradients of ellipses, means, opacities and colours, from the (S, 9) sums that composite_tiles.h describes."""
    whole, u, u_dy, u_u, dy, dy_dy = sums[:, 3:].unbind(1)
    across, slope, down = shapes.unbind(1)
    to_shapes = torch.stack([-0.5 * u_u, across * u_dy, -0.5 * dy_dy], 1)
    along = across * u
    to_means = torch.stack([along, down * dy - slope * along], 1)
    return to_shapes, to_means, whole / opacities, sums[:, :3]


def draw(gaussians: Gaussians, camera: Camera, background: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """The (H, W, 3) picture, (M, 2) means, (S,) which are seen, and their (S,) sums of alpha times transmittance.

    Args:
        gaussians: M of them.
        camera: where from.
        background: (3,) colour behind everything.

    Raises:
        InvalidInput: ``input-dependency`` where Triton is not installed.
    """
    lens = Lens.of(camera, gaussians.centres)
    local = to_camera(gaussians.centres, lens)
    means = to_pixels(local, lens)
    held = Gaussians(*(one.detach() for one in gaussians.tensors()))
    seen = see(local.detach(), means.detach(), held, lens)
    centres, which = means.detach()[seen.which], seen.which
    shades = held.opacities[which, None].log2(), held.colours[which]
    splats = torch.cat([centres, seen.ellipses, seen.half_row[:, None], seen.halves, *shades], 1)
    view = _View(seen, splats, list_tiles(centres, seen.halves, camera), camera)
    inputs = means, ellipses(local, gaussians, seen, lens), gaussians.opacities, gaussians.colours, background
    image, weights = cast(tuple[Tensor, Tensor], _Composite.apply(*inputs, view))  # type: ignore[no-untyped-call]
    return image, means, which, weights[:, 0]
