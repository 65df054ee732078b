"""The splats that may show in each tile of the picture."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from reference_encoder.training.raster.loading import TILE
from scarfmt.render.camera import Camera


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


def list_tiles(means: Tensor, halves: Tensor, camera: Camera) -> Listing:
    """List the tiles with pixel centres in the bounds of S splats, each of which touches one.

    Args:
        means: (S, 2) float32 pixels, without gradient.
        halves: (S, 2) float32 half extents, pixels.
        camera: gives the size of the picture.
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
