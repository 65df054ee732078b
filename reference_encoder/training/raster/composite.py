"""Splats blended into a picture on the CPU, and its gradient: what composite.c is given, and what comes of it."""

from __future__ import annotations

from ctypes import byref, c_float, c_int64
from typing import Any, cast

import torch
from torch import Tensor

from reference_encoder.training.raster.gaussians import Gaussians
from reference_encoder.training.raster.loading import GRADIENTS, Job, load, on_threads, pointer
from reference_encoder.training.raster.prepare import Prepared
from scarfmt.render.camera import Camera
from scarfmt.render.projection import MAX_ALPHA, MIN_ALPHA, MIN_TRANSMITTANCE


def _job(camera: Camera, prepared: Prepared, background: Tensor) -> Job:
    listing = prepared.listing
    job = Job(width=camera.width, height=camera.height, columns=listing.columns, tiles=len(listing.offsets) - 1)
    job.max_alpha, job.min_alpha, job.min_transmittance = MAX_ALPHA, MIN_ALPHA, MIN_TRANSMITTANCE
    job.background = (c_float * 3)(*background.tolist())
    job.splats, job.offsets = pointer(prepared.splats), pointer(listing.offsets, torch.int64)
    job.listed, job.owners = pointer(listing.listed, torch.int32), pointer(listing.owners, torch.int32)
    return job


def _on_tiles(name: str, job: Job) -> None:
    """Have all threads take tiles from one counter until none is left."""
    counter, function = c_int64(0), getattr(load(), name)
    on_threads(lambda first, past: function(byref(job), byref(counter)), job.tiles)


def _weights(prepared: Prepared, parts: Tensor) -> Tensor:
    """(M,) sums of the (I,) weights of each Gaussian."""
    sums = torch.zeros(len(prepared.places))
    starts, which = pointer(prepared.listing.starts, torch.int64), pointer(prepared.which, torch.int64)

    def share(first: int, past: int) -> None:
        load().scar_composite_weights(pointer(parts), starts, which, first, past, pointer(sums))

    on_threads(share, len(prepared.which))
    return sums


def _gather(prepared: Prepared, parts: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Gradients of (S, 3) ellipses, (M, 2) means, (M,) opacities, (M, 3) colours from the (I, 9) of intersections."""
    count, seen = len(prepared.places), len(prepared.which)
    sums = torch.empty(seen, 3), torch.zeros(count, 2), torch.zeros(count), torch.zeros(count, 3)
    starts, which = pointer(prepared.listing.starts, torch.int64), pointer(prepared.which, torch.int64)
    rows, out = (pointer(parts), starts, which, pointer(prepared.splats)), [pointer(one) for one in sums]
    on_threads(lambda first, past: load().scar_composite_gather(*rows, first, past, *out), seen)
    return sums


class _Composite(torch.autograd.Function):
    """:func:`composite` as a function of tensors."""

    @staticmethod
    def forward(
        ctx: Any,
        means: Tensor,
        ellipses: Tensor,
        opacities: Tensor,
        colours: Tensor,
        background: Tensor,
        prepared: Prepared,
        camera: Camera,
    ) -> tuple[Tensor, Tensor]:
        image, left = torch.empty(camera.height, camera.width, 3), torch.empty(camera.height, camera.width)
        parts = torch.empty(len(prepared.listing.listed))
        drawn = torch.empty(len(prepared.listing.offsets) - 1, dtype=torch.int32)
        job = _job(camera, prepared, background)
        job.image, job.transmittance, job.weights = pointer(image), pointer(left), pointer(parts)
        job.drawn = pointer(drawn, torch.int32)
        _on_tiles("scar_composite", job)
        weights = _weights(prepared, parts)
        ctx.save_for_backward(background, image)
        ctx.state = left, drawn, prepared, camera
        ctx.mark_non_differentiable(weights)
        return image, weights

    @staticmethod
    def backward(ctx: Any, towards: Tensor, _: Tensor) -> tuple[Tensor | None, ...]:
        background, image = ctx.saved_tensors
        left, drawn, prepared, camera = ctx.state
        towards = towards.contiguous()
        parts = torch.empty(len(prepared.listing.listed), GRADIENTS)
        job = _job(camera, prepared, background)
        job.image, job.drawn = pointer(image), pointer(drawn, torch.int32)
        job.towards, job.gradients = pointer(towards), pointer(parts)
        _on_tiles("scar_composite_back", job)
        to_ellipses, to_means, to_opacities, to_colours = _gather(prepared, parts)
        to_background = (towards * left[..., None]).sum((0, 1)) if ctx.needs_input_grad[4] else None
        return to_means, to_ellipses, to_opacities, to_colours, to_background, None, None


def composite(prepared: Prepared, gaussians: Gaussians, background: Tensor, camera: Camera) -> tuple[Tensor, Tensor]:
    """The picture, (H, W, 3) with a gradient, and (M,) sums of alpha times transmittance, without.

    Args:
        prepared: what shows of the Gaussians, and where.
        gaussians: M of them; gradients of opacities and colours arrive there.
        background: (3,) colour behind everything.
        camera: gives the size of the picture.
    """
    inputs = prepared.means, prepared.ellipses, gaussians.opacities, gaussians.colours, background
    return cast(tuple[Tensor, Tensor], _Composite.apply(*inputs, prepared, camera))  # type: ignore[no-untyped-call]
