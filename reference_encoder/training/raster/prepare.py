"""Gaussians projected, sorted and listed by tiles on the CPU: what project.c and bins.c are given and return.

The same as :mod:`.projection` and :mod:`.binning` do in torch, in a third of the time.
"""

from __future__ import annotations

from ctypes import byref, c_double
from dataclasses import dataclass
from typing import Any, cast

import torch
from torch import Tensor

from reference_encoder.training.raster import loading
from reference_encoder.training.raster.binning import Listing
from reference_encoder.training.raster.gaussians import Gaussians
from reference_encoder.training.raster.loading import ELLIPSE, SPLAT, TILE, load, on_threads, pointer
from scarfmt.render.camera import Camera
from scarfmt.render.projection import FRUSTUM_MARGIN, MIN_ALPHA


@dataclass(frozen=True)
class Prepared:
    """S of M Gaussians show, and are numbered nearest first; of two as near, the first is.

    Attributes:
        means: (M, 2) float32 pixels, with a gradient.
        ellipses: (S, 3) float32 across, slope, down (:mod:`.projection`), with a gradient.
        which: (S,) int64 numbers among the M.
        places: (M,) int32 numbers among the S, or -1.
        splats: (S, 12) float32 rows as `Splat` of raster.h.
        listing: in which tiles they may show.
    """

    means: Tensor
    ellipses: Tensor
    which: Tensor
    places: Tensor
    splats: Tensor
    listing: Listing


def _lens(camera: Camera) -> loading.Lens:
    limit_x, limit_y = FRUSTUM_MARGIN * camera.width / (2 * camera.fx), FRUSTUM_MARGIN * camera.height / (2 * camera.fy)
    widest = max(camera.fx**2 * (1 + limit_x**2), camera.fy**2 * (1 + limit_y**2))
    pose = (c_double * 12)(*camera.world_to_camera[:3].ravel().tolist())
    size = camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height
    return loading.Lens(pose, *size, camera.near, camera.dilation, limit_x, limit_y, widest, MIN_ALPHA)


@dataclass(frozen=True)
class _View:
    """Gaussians and a camera as the library takes them; `held` keeps the memory."""

    held: Gaussians
    scene: loading.Scene
    lens: loading.Lens

    @staticmethod
    def of(gaussians: Gaussians, camera: Camera) -> _View:
        held = Gaussians(*(one.detach().contiguous() for one in gaussians.tensors()))
        return _View(held, loading.Scene(*(pointer(one) for one in held.tensors())), _lens(camera))


def _nearest_first(keys: Tensor) -> Tensor:
    """(S,) int64: which of the (M,) keys are not those of unseen Gaussians, the nearest first."""
    entries, which = torch.empty((2, len(keys)), dtype=torch.int64), torch.empty(len(keys), dtype=torch.int64)
    rows = [pointer(one, torch.int64) for one in (*entries, which)]
    return which[: load().scar_nearest_first(pointer(keys, torch.int32), len(keys), *rows)]


def _listed(splats: Tensor, camera: Camera) -> Listing:
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
        ctx: Any, centres: Tensor, scales: Tensor, rotations: Tensor, view: _View, places: Tensor, *found: Tensor
    ) -> tuple[Tensor, ...]:
        ctx.view, ctx.places = view, places
        return found

    @staticmethod
    def backward(ctx: Any, to_means: Tensor, to_ellipses: Tensor) -> tuple[Tensor | None, ...]:
        view, count = ctx.view, len(ctx.places)
        gradients = [torch.empty_like(one) for one in (view.held.centres, view.held.scales, view.held.rotations)]
        towards = to_means.contiguous(), to_ellipses.contiguous()
        rows = [pointer(ctx.places, torch.int32), *(pointer(one) for one in (*towards, *gradients))]

        def share(first: int, past: int) -> None:
            load().scar_project_back(byref(view.scene), byref(view.lens), first, past, *rows)

        on_threads(share, count)
        return *gradients, None, None, None, None


def prepare(gaussians: Gaussians, camera: Camera) -> Prepared:
    """Project M Gaussians, and list those that show by tiles.

    Raises:
        InvalidInput: ``input-dependency`` where the compiled library is missing.
    """
    library, view, count = load(), _View.of(gaussians, camera), len(gaussians.centres)
    means, ellipses = torch.empty(count, 2), torch.empty(count, ELLIPSE)
    keys = torch.empty(count, dtype=torch.int32)
    filled = pointer(means), pointer(keys, torch.int32), pointer(ellipses)
    on_threads(lambda first, past: library.scar_project(view.scene, view.lens, first, past, *filled), count)
    which = _nearest_first(keys)
    splats = torch.empty(len(which), SPLAT)
    rows = pointer(means), pointer(ellipses), pointer(splats)
    order = pointer(which, torch.int64)
    on_threads(lambda first, past: library.scar_arrange(view.scene, order, first, past, *rows), len(which))
    places = torch.full((count,), -1, dtype=torch.int32)
    places[which] = torch.arange(len(which), dtype=torch.int32)
    inputs = gaussians.centres, gaussians.scales, gaussians.rotations, view, places
    made = _Projected.apply(*inputs, means, splats[:, 2:5].clone())  # type: ignore[no-untyped-call]
    means, shapes = cast(tuple[Tensor, Tensor], made)
    return Prepared(means, shapes, which, places, splats, _listed(splats, camera))
