"""Blending splats into a picture, on the CPU, and its gradient: what composite.c is given, and what comes of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from ctypes import c_float, c_int64
from functools import cache
from typing import Any, cast

import torch
from torch import Tensor

from reference_encoder.training.raster.binning import Listing
from reference_encoder.training.raster.loading import GRADIENTS, Job, load, run
from reference_encoder.training.raster.projection import Gaussians, Seen
from scarfmt.render.camera import Camera
from scarfmt.render.projection import MAX_ALPHA, MIN_ALPHA, MIN_TRANSMITTANCE

_SPLAT = 12
_POWERS_OF_TWO = 0.5 / math.log(2)
"""Half a square in natural exponents, as an exponent of two."""


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, "raster")


def _on_threads(work: Callable[[int, int], None]) -> None:
    """Call `work` with (thread, threads) on as many threads as torch uses, this one among them."""
    threads = torch.get_num_threads()
    others = [_pool(threads - 1).submit(work, thread, threads) for thread in range(1, threads)]
    work(0, threads)
    for other in others:
        other.result()


def _pointer(tensor: Tensor, dtype: torch.dtype) -> int:
    """Where the numbers of a tensor lie.

    Raises:
        TypeError: they are of another type than `dtype`, not in one piece, or on another device.
    """
    if tensor.dtype != dtype or not tensor.is_contiguous() or tensor.device.type != "cpu":
        raise TypeError(f"{tensor.dtype} of strides {tensor.stride()} on {tensor.device}, not {dtype} in C order")
    return tensor.data_ptr()


def _splats(means: Tensor, ellipses: Tensor, opacities: Tensor, colours: Tensor, seen: Seen) -> Tensor:
    """(S, 12) float32 rows as `Splat` of composite.c."""
    table = torch.empty((len(means), _SPLAT), dtype=torch.float32)
    table[:, 0:2] = means
    table[:, 2:5] = ellipses
    table[:, 2] *= _POWERS_OF_TWO
    table[:, 4] *= _POWERS_OF_TWO
    table[:, 5] = opacities.log2()
    table[:, 6:9] = colours
    table[:, 9] = seen.half_row
    table[:, 10] = seen.halves[:, 1]
    table[:, 11] = 0
    return table


def _job(camera: Camera, listing: Listing, splats: Tensor, background: Tensor) -> Job:
    job = Job(width=camera.width, height=camera.height, columns=listing.columns, tiles=len(listing.offsets) - 1)
    job.max_alpha, job.min_alpha, job.min_transmittance = MAX_ALPHA, MIN_ALPHA, MIN_TRANSMITTANCE
    job.background = (c_float * 3)(*background.tolist())
    job.splats = _pointer(splats, torch.float32)
    job.offsets = _pointer(listing.offsets, torch.int64)
    job.listed, job.owners = _pointer(listing.listed, torch.int32), _pointer(listing.owners, torch.int32)
    return job


def _composite(name: str, job: Job) -> None:
    counter = c_int64(0)
    _on_threads(lambda thread, threads: run(name, job, counter))


def _gather(rows: Tensor, listing: Listing) -> Tensor:
    """(S, wide) sums of the (I, wide) rows of each splat, in the order of their numbers."""
    count, wide = len(listing.starts) - 1, rows.shape[1]
    sums = torch.empty((count, wide), dtype=torch.float32)
    places = _pointer(rows, torch.float32), wide, _pointer(listing.starts, torch.int64)

    def add(thread: int, threads: int) -> None:
        first, past = count * thread // threads, count * (thread + 1) // threads
        load().scar_composite_gather(*places, first, past, sums.data_ptr())

    _on_threads(add)
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
        seen: Seen,
        listing: Listing,
        camera: Camera,
    ) -> tuple[Tensor, Tensor]:
        which = seen.which
        splats = _splats(means[which], ellipses, opacities[which], colours[which], seen)
        image, left = torch.empty(camera.height, camera.width, 3), torch.empty(camera.height, camera.width)
        weights = torch.empty(len(listing.listed), 1)
        drawn = torch.empty(len(listing.offsets) - 1, dtype=torch.int32)
        job = _job(camera, listing, splats, background)
        job.image, job.transmittance = _pointer(image, torch.float32), _pointer(left, torch.float32)
        job.weights, job.drawn = _pointer(weights, torch.float32), _pointer(drawn, torch.int32)
        _composite("scar_composite", job)
        total = _gather(weights, listing)[:, 0]
        ctx.save_for_backward(means, ellipses, opacities, colours, background, image)
        ctx.state = splats, left, drawn, seen, listing, camera
        ctx.mark_non_differentiable(total)
        return image, total

    @staticmethod
    def backward(ctx: Any, towards: Tensor, _: Tensor) -> tuple[Tensor | None, ...]:
        means, ellipses, opacities, colours, background, image = ctx.saved_tensors
        splats, left, drawn, seen, listing, camera = ctx.state
        towards = towards.contiguous()
        rows = torch.empty(len(listing.listed), GRADIENTS)
        job = _job(camera, listing, splats, background)
        job.image, job.drawn = _pointer(image, torch.float32), _pointer(drawn, torch.int32)
        job.towards, job.gradients = _pointer(towards, torch.float32), _pointer(rows, torch.float32)
        _composite("scar_composite_back", job)
        to_colours, to_opacities, to_ellipses, to_means = _of_splats(
            _gather(rows, listing), ellipses, opacities[seen.which]
        )
        to_background = (towards * left[..., None]).sum((0, 1)) if ctx.needs_input_grad[4] else None
        scattered = (
            torch.zeros_like(whole).index_copy_(0, seen.which, part)
            for whole, part in ((means, to_means), (opacities, to_opacities), (colours, to_colours))
        )
        to_means, to_opacities, to_colours = scattered
        return to_means, to_ellipses, to_opacities, to_colours, to_background, None, None, None


def composite(
    means: Tensor,
    ellipses: Tensor,
    gaussians: Gaussians,
    background: Tensor,
    seen: Seen,
    listing: Listing,
    camera: Camera,
) -> tuple[Tensor, Tensor]:
    """The picture, (H, W, 3) with a gradient, and (S,) sums of alpha times transmittance of what is seen, without.

    Args:
        means: (M, 2) pixels.
        ellipses: (S, 3) across, slope, down.
        gaussians: the M Gaussians; of these, opacities and colours are taken.
        background: (3,) colour behind everything.
        seen: which of them show, in which order.
        listing: in which tiles.
        camera: gives the size of the picture.

    Raises:
        InvalidInput: ``input-dependency`` where the compiled kernel is missing.
    """
    inputs = means, ellipses, gaussians.opacities, gaussians.colours, background
    return cast(tuple[Tensor, Tensor], _Composite.apply(*inputs, seen, listing, camera))  # type: ignore[no-untyped-call]


def _of_splats(sums: Tensor, ellipses: Tensor, opacities: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Gradients of colours, opacities, ellipses and means, from the (S, 9) sums that composite.c describes."""
    whole, u, u_dy, u_u, dy, dy_dy = sums[:, 3:].unbind(1)
    across, slope, down = ellipses.unbind(1)
    to_ellipses = torch.stack([-0.5 * u_u, across * u_dy, -0.5 * dy_dy], 1)
    along = across * u
    to_means = torch.stack([along, down * dy - slope * along], 1)
    return sums[:, :3], whole / opacities, to_ellipses, to_means
