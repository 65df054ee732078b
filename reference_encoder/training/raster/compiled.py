"""Pictures of Gaussians on the CPU, with gradients, by the compiled renderer (docs/decisions/0034)."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from ctypes import byref, c_float, c_int64
from dataclasses import dataclass
from functools import cache
from typing import Any, cast

import torch
from torch import Tensor

from scarfmt.render.camera import Camera
from scarfmt.render.native.binding import BLEND, GRADIENTS, SPLAT, TILE, UNBLEND, Job, Lens, Scene, load


@dataclass(frozen=True)
class Gaussians:
    """M Gaussians as a renderer wants them; float32, any of them with a gradient.

    Attributes:
        centres: (M, 3) world units.
        scales: (M, 3) standard deviations along the axes, world units, positive.
        rotations: (M, 4) quaternions w x y z of any length.
        opacities: (M,) 0..1.
        colours: (M, 3), 1 is white.
    """

    centres: Tensor
    scales: Tensor
    rotations: Tensor
    opacities: Tensor
    colours: Tensor

    def tensors(self) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
        """All tensors, in this order."""
        return self.centres, self.scales, self.rotations, self.opacities, self.colours


def pointer(tensor: Tensor, dtype: torch.dtype = torch.float32) -> int:
    """Address of the numbers of a tensor.

    Raises:
        TypeError: they are of another type than `dtype`, not in one piece, or on another device.
    """
    if tensor.dtype != dtype or not tensor.is_contiguous() or tensor.device.type != "cpu":
        raise TypeError(f"{tensor.dtype} of strides {tensor.stride()} on {tensor.device}, not {dtype} in C order")
    return tensor.data_ptr()


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, "raster")


def on_threads(work: Callable[[int, int, int], None], count: int) -> None:
    """Call `work` with (first, past, thread) of shares of `count` things on as many threads as torch uses, with this
    one."""
    threads = torch.get_num_threads()
    shares = [(count * thread // threads, count * (thread + 1) // threads, thread) for thread in range(threads)]
    others = [_pool(threads - 1).submit(work, *share) for share in shares[1:]]
    work(*shares[0])
    for other in others:
        other.result()


@dataclass(frozen=True)
class Listing:
    """I intersections of splats and tiles: numbered splat by splat, tiles row by row; listed tile by tile.

    Attributes:
        columns: tiles side by side.
        offsets: (tiles + 1,) int64, where the list of a tile starts.
        listed: (I,) int32 numbers, of a tile in the order of the splats.
        owners: (I,) int32, the splats of those listed.
        starts: (S + 1,) int64, the first number of each splat.
    """

    columns: int
    offsets: Tensor
    listed: Tensor
    owners: Tensor
    starts: Tensor


@dataclass(frozen=True)
class Prepared:
    """S of M Gaussians show, and are numbered nearest first; of two as near, the first is.

    Attributes:
        means: (M, 2) float32 pixels, with a gradient; of those that do not show, 0.
        ellipses: (S, 3) float32 across, slope, down (:mod:`.projection`), with a gradient.
        which: (S,) int64 numbers among the M.
        splats: (S, 12) float32 rows as `Splat` of raster.h.
        listing: in which tiles they may show.
    """

    means: Tensor
    ellipses: Tensor
    which: Tensor
    splats: Tensor
    listing: Listing


_Packed = tuple[tuple[Tensor, ...], Scene, Lens]
"""Gaussians and a camera as the library takes them; the first of the three keeps the memory."""


def _pack(gaussians: Gaussians, camera: Camera) -> _Packed:
    centres, *others = (one.detach().contiguous() for one in gaussians.tensors())
    exact = centres.double()
    scene = Scene(pointer(exact, torch.float64), *(pointer(one) for one in others))
    return (exact, *others), scene, Lens.of(camera)


def _see(scene: Scene, lens: Lens, count: int) -> tuple[Tensor, Tensor]:
    """(S, 12) splats of those of M Gaussians that show, nearest first, and the (S,) int64 numbers of these."""
    candidates, numbers, order = torch.empty((3, count), dtype=torch.int32)
    torch.arange(count, dtype=torch.int32, out=candidates)
    entries, splats = torch.empty((2, count), dtype=torch.int64), torch.empty((2, count, SPLAT))
    sorting = [pointer(one, torch.int64) for one in entries]
    found = pointer(numbers, torch.int32), pointer(splats[1]), pointer(order, torch.int32)
    seen = load().scar_see(scene, lens, pointer(candidates, torch.int32), count, *sorting, pointer(splats[0]), *found)
    return splats[1, :seen], numbers.index_select(0, order[:seen]).long()


def _list(splats: Tensor, camera: Camera) -> Listing:
    columns, rows = -(-camera.width // TILE), -(-camera.height // TILE)
    spans = torch.empty((len(splats), 4), dtype=torch.int32)
    starts, offsets = (torch.empty(count + 1, dtype=torch.int64) for count in (len(splats), columns * rows))
    places = pointer(spans, torch.int32), pointer(starts, torch.int64), pointer(offsets, torch.int64)
    load().scar_count_tiles(pointer(splats), len(splats), camera.width, camera.height, *places)
    listed, owners = torch.empty((2, int(offsets[-1])), dtype=torch.int32)
    fill = offsets.clone()
    filled = pointer(fill, torch.int64), pointer(listed, torch.int32), pointer(owners, torch.int32)
    load().scar_list_tiles(places[0], len(splats), columns, *filled)
    return Listing(columns, offsets, listed, owners, starts)


class _Projected(torch.autograd.Function):
    """Means and ellipses as functions of what they were projected from."""

    @staticmethod
    def forward(
        ctx: Any, centres: Tensor, scales: Tensor, rotations: Tensor, view: _Packed, which: Tensor, *built: Tensor
    ) -> tuple[Tensor, ...]:
        ctx.view, ctx.which, ctx.count = view, which, len(centres)
        return built

    @staticmethod
    def backward(ctx: Any, to_means: Tensor, to_ellipses: Tensor) -> tuple[Tensor | None, ...]:
        _, scene, lens = ctx.view
        gradients = [torch.zeros(ctx.count, width) for width in (3, 3, 4)]
        towards = to_means.contiguous(), to_ellipses.contiguous()
        which, rows = pointer(ctx.which, torch.int64), [pointer(one) for one in (*towards, *gradients)]
        back = load().scar_project_back
        on_threads(lambda first, past, _: back(scene, lens, which, first, past, *rows), len(ctx.which))
        return *gradients, None, None, None, None


def prepare(gaussians: Gaussians, camera: Camera) -> Prepared:
    """Project M Gaussians, and list those that show by tiles.

    Raises:
        InvalidInput: ``input-dependency`` where the compiled library is missing.
    """
    view, count = _pack(gaussians, camera), len(gaussians.centres)
    splats, which = _see(*view[1:], count)
    means = torch.zeros(count, 2).index_copy_(0, which, splats[:, :2])
    inputs = gaussians.centres, gaussians.scales, gaussians.rotations, view, which
    made = _Projected.apply(*inputs, means, splats[:, 2:5].clone())  # type: ignore[no-untyped-call]
    means, shapes = cast(tuple[Tensor, Tensor], made)
    return Prepared(means, shapes, which, splats, _list(splats, camera))


def _job(camera: Camera, prepared: Prepared, background: Tensor) -> Job:
    listing = prepared.listing
    job = Job.of(camera)
    job.background = (c_float * 3)(*background.tolist())
    job.splats, job.offsets = pointer(prepared.splats), pointer(listing.offsets, torch.int64)
    job.listed, job.owners = pointer(listing.listed, torch.int32), pointer(listing.owners, torch.int32)
    return job


def _on_tiles(work: int, job: Job) -> None:
    """Have all threads take tiles from one counter until none is left."""
    counter, function = c_int64(0), load().scar_composite
    on_threads(lambda *_: function(byref(job), work, byref(counter)), job.tiles)


def sum_by_splat(rows: Tensor, listing: Listing) -> Tensor:
    """(S, wide) sums of the (I, wide) rows of each splat, in the order of their numbers."""
    if len(rows) == 0:
        return rows.new_zeros(len(listing.starts) - 1, rows.shape[1])
    sums: Tensor = torch.segment_reduce(rows, "sum", offsets=listing.starts, axis=0, initial=0)
    return sums


def _gather(prepared: Prepared, count: int, parts: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Gradients of (S, 3) ellipses, (M, 2) means, (M,) opacities, (M, 3) colours from the (I, 9) of intersections."""
    seen = len(prepared.which)
    sums = torch.empty(seen, 3), torch.zeros(count, 2), torch.zeros(count), torch.zeros(count, 3)
    starts, which = pointer(prepared.listing.starts, torch.int64), pointer(prepared.which, torch.int64)
    rows, out = (pointer(parts), starts, which, pointer(prepared.splats)), [pointer(one) for one in sums]
    on_threads(lambda first, past, _: load().scar_composite_gather(*rows, first, past, *out), seen)
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
        parts = torch.empty(len(prepared.listing.listed), 1)
        drawn = torch.empty(len(prepared.listing.offsets) - 1, dtype=torch.int32)
        job = _job(camera, prepared, background)
        job.image, job.transmittance, job.weights = pointer(image), pointer(left), pointer(parts)
        job.drawn = pointer(drawn, torch.int32)
        _on_tiles(BLEND, job)
        weights = sum_by_splat(parts, prepared.listing)[:, 0]
        ctx.save_for_backward(background, image)
        ctx.state, ctx.count = (left, drawn, prepared, camera), len(means)
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
        _on_tiles(UNBLEND, job)
        to_ellipses, to_means, to_opacities, to_colours = _gather(prepared, ctx.count, parts)
        to_background = (towards * left[..., None]).sum((0, 1)) if ctx.needs_input_grad[4] else None
        return to_means, to_ellipses, to_opacities, to_colours, to_background, None, None


def composite(prepared: Prepared, gaussians: Gaussians, background: Tensor, camera: Camera) -> tuple[Tensor, Tensor]:
    """The picture, (H, W, 3) with a gradient, and (S,) sums of alpha times transmittance, without.

    Args:
        prepared: what shows of the Gaussians, and where.
        gaussians: M of them; gradients of opacities and colours arrive there.
        background: (3,) colour behind everything.
    """
    inputs = prepared.means, prepared.ellipses, gaussians.opacities, gaussians.colours, background
    return cast(tuple[Tensor, Tensor], _Composite.apply(*inputs, prepared, camera))  # type: ignore[no-untyped-call]
