"""Tight boxes of tiles in the world, and how large they look."""

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
_ROOTS = (1.0, 1.189207115002721, 1.4142135623730951, 1.681792830507429)


@dataclass(frozen=True)
class Boxes:
    """Boxes of T tiles, world units.

    Attributes:
        low, high: (T, 3) float64.
        reach: (T,) float64, how far splats stick out.
    """

    low: F64
    high: F64
    reach: F64


def octaves(first: int, steps: int) -> F64:
    """(steps,) float64: 2^(k / 4) for k = `first`, `first` + 1, ...; each the one four before it, doubled.

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


def cubes(fields: HeaderFields, tiles: Table) -> tuple[F64, F64]:
    """Lowest corners (T, 3) and sides (T,) of the cubes of tiles, world units."""
    free = (fields.lattice_bits - tiles["depth"].astype(np.int64)).astype(np.float64)
    side = np.ldexp(1.0, free.astype(np.int64))
    corner = deinterleave(tiles["prefix"]).astype(np.float64) * side[:, None]
    return np.array(fields.origin) + fields.voxel * corner, fields.voxel * side


def tight_boxes(fields: HeaderFields, tiles: Table, streaming: Streaming | None) -> Boxes:
    """What a file says of where its tiles are; the cubes where it has no STREAMING block."""
    corner, side = cubes(fields, tiles)
    if streaming is None:
        return Boxes(corner, corner + side[:, None], np.zeros(len(side)))
    part = side[:, None] / 256
    low = corner + part * streaming.low
    high = corner + part * (streaming.high.astype(np.float64) + 1)
    reach = np.where(streaming.reach > 0, side * _REACHES[streaming.reach], 0.0)
    return Boxes(low, high, reach)


def coverage(boxes: Boxes, eye: F64) -> F64:
    """(T,) float64 solid angle that boxes take up, seen from `eye` (3,): their projected area by squared distance.

    Boxes are wider by their reach. One that `eye` is in, or next to, is all round.
    """
    half = (boxes.high - boxes.low) / 2 + boxes.reach[:, None]
    away = np.abs((boxes.low + boxes.high) / 2 - eye)
    squared = away[:, 0] * away[:, 0] + away[:, 1] * away[:, 1] + away[:, 2] * away[:, 2]
    distance = np.sqrt(squared)
    area = away[:, 0] * half[:, 1] * half[:, 2] + away[:, 1] * half[:, 0] * half[:, 2]
    area = 4 * (area + away[:, 2] * half[:, 0] * half[:, 1])
    inside = (away[:, 0] <= half[:, 0]) & (away[:, 1] <= half[:, 1]) & (away[:, 2] <= half[:, 2])
    near = inside | (area >= ALL_ROUND * squared * distance)
    return np.where(near, ALL_ROUND, area / np.where(near, 1.0, squared * distance))
