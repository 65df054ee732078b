"""How many layers each tile gets of a number of Gaussians in all, and which tile is needed first."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F64, I64
from scarfmt.blocks.streaming import Streaming
from scarfmt.streaming.boxes import Boxes, tight_boxes
from scarfmt.streaming.plan import SceneIndex, weighed
from scarfmt.streaming.view import MARGIN, Camera, axes_of, tangent

_FIRST, _BESIDE, _FURTHER = 0, 1, 2
"""Ranks: layer 1 of tiles in the picture, so that there are no holes; layer 1 of others; what is gained most by."""


@dataclass(frozen=True)
class Parts:
    """Layers of tiles that are taken together or not at all, n of them.

    Attributes:
        file, tile: (n,) int64.
        low, layers: (n,) int64 layers of the tile before and after.
        rank: (n,) int64.
        worth: (n,) float64 what is gained by a Gaussian.
        gaussians: (n,) int64 that come.
    """

    file: I64
    tile: I64
    low: I64
    layers: I64
    rank: I64
    worth: F64
    gaussians: I64

    @classmethod
    def joined(cls, parts: Sequence[Parts]) -> Parts:
        """The parts of all files, in the order to take them; equal parts by layer, file, tile."""
        if not parts:
            none = np.zeros(0, np.int64)
            return cls(none, none, none, none, none, np.zeros(0), none)
        all_ = {name: np.concatenate([getattr(one, name) for one in parts]) for name in vars(parts[0])}
        order = np.lexsort((all_["tile"], all_["file"], all_["low"], -all_["worth"], all_["rank"]))
        return cls(**{name: values[order] for name, values in all_.items()})

    def within(self, gaussians: float) -> NDArray[np.bool_]:
        """(n,) bool which are taken of so many Gaussians: in order, over those that do not fit any more."""
        total = np.cumsum(self.gaussians)
        fit = int(np.searchsorted(total, gaussians, side="right"))
        taken = np.arange(len(total)) < fit
        left = gaussians - (float(total[fit - 1]) if fit else 0.0)
        missed: set[tuple[int, int]] = set()
        rows = zip(self.file[fit:].tolist(), self.tile[fit:].tolist(), self.gaussians[fit:].tolist(), strict=True)
        for number, (file, tile, more) in enumerate(rows, start=fit):
            # What comes after a part that was left out needs it.
            if more > left or (file, tile) in missed:
                missed.add((file, tile))
            else:
                taken[number] = True
                left -= more
        return taken


def parts_of(
    number: int,
    index: SceneIndex,
    streaming: Streaming | None,
    camera: Camera,
    *,
    layers: int,
    tiles: I64,
    outside: bool,
) -> Parts:
    """The parts of one file that can be fetched.

    Args:
        number: of the file.
        index: what its front says.
        streaming: what it tells clients, or None.
        camera: in the coordinates of the file.
        layers: how many there are to take.
        tiles: (n,) those asked for.
        outside: whether tiles that are out of the picture get layer 1; else they get nothing.
    """
    gains = weighed(index, streaming, camera, [0] * len(index.bytes))[0][tiles, :layers]
    new = index.slots * index.counts[tiles, :layers]
    boxes = tight_boxes(index.cubes[tiles], None if streaming is None else _rows(streaming, tiles))
    seen = meets_picture(boxes, camera)
    rank = np.where(seen, _FIRST, _BESIDE)
    worth = gains[:, 0] / (new[:, 0] + 1)
    at = np.arange(len(tiles))
    found = [(at, np.zeros_like(at), np.ones_like(at), rank, worth, new[:, 0])]
    found += _further(gains, new)
    rows = [np.concatenate(column) for column in zip(*found, strict=True)]
    # Tiles out of the picture get their first layer, or nothing.
    kept = seen[rows[0]] | (outside & (rows[3] == _BESIDE))
    place, low, after, ranks, worths, gaussians = (row[kept] for row in rows)
    return Parts(np.full(len(place), number), tiles[place], low, after, ranks, worths, gaussians)


Rows = tuple[I64, I64, I64, I64, F64, I64]


def _further(gains: F64, new: I64) -> list[Rows]:
    """The parts after layer 1, as in :func:`scarfmt.streaming.plan.plan`: each takes the layers of largest mean gain.

    Args:
        gains: (T, L) float64.
        new: (T, L) int64 Gaussians.
    """
    tiles, layers = gains.shape
    start = np.ones(tiles, np.int64)
    out: list[Rows] = []
    number = np.arange(layers)
    while True:
        rest = np.flatnonzero(start < layers)
        if not len(rest):
            return out
        later = number >= start[rest, None]
        gain, cost = (np.cumsum(np.where(later, values[rest], 0), axis=1) for values in (gains, new))
        # One more: what refines without adding Gaussians costs next to nothing, but something.
        worth = np.where(later, gain / (cost + 1), -math.inf)
        past = worth.argmax(axis=1)
        at = np.arange(len(rest)), past
        rank = np.full(len(rest), _FURTHER)
        out.append((rest, start[rest], past + 1, rank, worth[at], cost[at]))
        start[rest] = past + 1


def _rows(streaming: Streaming, tiles: I64) -> Streaming:
    return Streaming(
        streaming.low[tiles],
        streaming.high[tiles],
        streaming.reach[tiles],
        streaming.viewpoints,
        streaming.gains[:, :, tiles],
        streaming.view,
    )


def meets_picture(boxes: Boxes, camera: Camera, margin: float = MARGIN) -> NDArray[np.bool_]:
    """(T,) bool: False only for boxes that are wholly beyond one of the four sides of the picture, or behind the eye.

    Args:
        boxes: of T tiles.
        camera: to look with, from where it will be.
        margin: how much wider than the picture counts.
    """
    forward, right, up = (np.array(axis) for axis in axes_of(camera))
    tall = margin * tangent(camera.fov_y / 2)
    wide = tall * (camera.width / camera.height)
    inwards = [forward, wide * forward + right, wide * forward - right, tall * forward + up, tall * forward - up]
    away, half = boxes.middle - camera.soon, boxes.half
    # The corner that is furthest inwards of a side.
    return np.asarray(np.all([away @ normal + half @ np.abs(normal) > 0 for normal in inwards], axis=0))


def chosen(parts: Parts, taken: NDArray[np.bool_]) -> tuple[I64, I64, I64, I64]:
    """File, tile, layers and Gaussians of each tile that anything is taken of, in the order they are needed first."""
    last: dict[tuple[int, int], tuple[int, int]] = {}
    rows = zip(*(getattr(parts, name).tolist() for name in ("file", "tile", "layers", "gaussians")), strict=True)
    for file, tile, layers, more in compress(rows, taken.tolist()):
        last[file, tile] = layers, last.get((file, tile), (0, 0))[1] + more
    found = np.array([(*place, *what) for place, what in last.items()], np.int64).reshape(-1, 4)
    return found[:, 0], found[:, 1], found[:, 2], found[:, 3]
