"""The places of tiles, and how large they look."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scarfmt.arrays import F64
from scarfmt.blocks.streaming import GAIN_STEPS, REACH_OF_SIDE, Streaming
from scarfmt.container.directory import Table
from scarfmt.container.header import HeaderFields
from scarfmt.container.morton import deinterleave

ALL_ROUND = 12.566370614359172
"""The solid angle of everything."""
SHOWN_OF_REACH = 0.5
"""How far splats count as sticking out of a tight box, of what the file says: where they are faint they show little."""
_ROOTS = (1.0, 1.189207115002721, 1.4142135623730951, 1.681792830507429)


@dataclass(frozen=True)
class Boxes:
    """Boxes of T tiles, world units.

    Attributes:
        low, high: (T, 3) float64.
    """

    low: F64
    high: F64

    @property
    def middle(self) -> F64:
        """(T, 3)."""
        return np.asarray((self.low + self.high) / 2)

    @property
    def half(self) -> F64:
        """(T, 3) half their sides."""
        return np.asarray((self.high - self.low) / 2)


def octaves(first: int, steps: int) -> F64:
    """(steps,) float64: 2^(k / 4) for k = `first`, `first` + 1, ...; each is the one four before it, doubled.

    `first` is a multiple of 4.
    """
    start = 1.0
    for _ in range(abs(first) // GAIN_STEPS):
        start = start * 2 if first > 0 else start / 2
    out: list[float] = []
    for k in range(steps):
        out.append(out[k - GAIN_STEPS] * 2 if k >= GAIN_STEPS else start * _ROOTS[k])
    return np.array(out)


_REACHES = octaves(-REACH_OF_SIDE, 256)


def cubes(fields: HeaderFields, tiles: Table) -> F64:
    """(T, 6) float64 lowest and highest corners of the cubes of tiles, world units (R-6.2-2)."""
    side = np.ldexp(1.0, fields.lattice_bits - tiles["depth"].astype(np.int64))[:, None]
    corner = deinterleave(tiles["prefix"]).astype(np.float64) * side
    origin = np.array(fields.origin)
    return np.concatenate([origin + fields.voxel * corner, origin + fields.voxel * (corner + side)], axis=1)


def tight_boxes(cubes: F64, streaming: Streaming | None) -> Boxes:
    """Boxes around the visible content of tiles; the cubes of the tiles if the file has no STREAMING block.

    Args:
        cubes: (T, 6) of the tiles.
        streaming: of as many tiles.
    """
    low, high = cubes[:, :3], cubes[:, 3:]
    if streaming is None:
        return Boxes(low, high)
    side = high - low
    part = side / 256
    reach = np.where(streaming.reach > 0, side[:, 0] * _REACHES[streaming.reach], 0.0)
    out = (SHOWN_OF_REACH * reach)[:, None]
    return Boxes(low + part * streaming.low - out, low + part * (streaming.high.astype(np.float64) + 1) + out)


def coverage(boxes: Boxes, eye: F64) -> F64:
    """(T,) float64 solid angle that boxes take up, seen from `eye` (3,): their projected area by squared distance.

    One that `eye` is in, or next to, is all round.
    """
    half, away = boxes.half, np.abs(boxes.middle - eye)
    squared = away[:, 0] * away[:, 0] + away[:, 1] * away[:, 1] + away[:, 2] * away[:, 2]
    distance = np.sqrt(squared)
    area = away[:, 0] * half[:, 1] * half[:, 2] + away[:, 1] * half[:, 0] * half[:, 2]
    area = 4 * (area + away[:, 2] * half[:, 0] * half[:, 1])
    inside = (away[:, 0] <= half[:, 0]) & (away[:, 1] <= half[:, 1]) & (away[:, 2] <= half[:, 2])
    near = inside | (area >= ALL_ROUND * squared * distance)
    return np.where(near, ALL_ROUND, area / np.where(near, 1.0, squared * distance))
