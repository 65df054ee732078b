"""Where tiles are, and how large a camera sees them: what chooses tiles and layers for a view.

`web/src/plan` computes the same numbers: all arithmetic is in binary64, with + - * / and square roots alone.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F64
from scarfmt.blocks.streaming import REACH_OF_SIDE, REACH_STEPS, Streaming
from scarfmt.container.directory import Table
from scarfmt.container.header import HeaderFields
from scarfmt.container.morton import deinterleave

FULL_SPHERE = 12.566370614359172
"""The solid angle of a whole sphere."""
REACH_SHARE = 0.5
"""Share of a tile's `reach` by which its tight box is widened: splats are faint at their ends."""
AHEAD_SECONDS = 0.5
"""How far ahead a moving camera is planned for."""
BEHIND = 0.02
"""Share of a tile that counts as in the picture where none is: a camera may turn, and splats stick out."""
MARGIN = 1.1
"""How much wider than the picture is planned for: cameras turn."""
SAMPLES = (-0.75, -0.25, 0.25, 0.75)
"""Sample places along each side of a box, in halves of the side."""
_TERMS = 25
"""Terms of the continued fraction of the tangent. It is exact up to rounding below a right angle."""
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


@dataclass(frozen=True)
class Camera:
    """A camera in world coordinates, as `web/src/plan/types.ts` has it.

    Attributes:
        position: (3,) of the eye.
        forward, up: (3,) of any length; `up` not along `forward`.
        fov_y: vertical field of view, radians, above 0 and below pi.
        width, height: of the picture, in any unit.
        velocity: (3,) world lengths a second, or None.
    """

    position: F64
    forward: F64
    up: F64
    fov_y: float
    width: float
    height: float
    velocity: F64 | None = None

    @property
    def position_ahead(self) -> F64:
        """(3,) where the eye will be."""
        return self.position if self.velocity is None else self.position + AHEAD_SECONDS * self.velocity


def octaves(first: int, steps: int) -> F64:
    """(steps,) float64: 2^(k / 4) for k = `first`, `first` + 1, ...; each is the one four before it, doubled.

    `first` is a multiple of 4.
    """
    start = 1.0
    for _ in range(abs(first) // REACH_STEPS):
        start = start * 2 if first > 0 else start / 2
    out: list[float] = []
    for k in range(steps):
        out.append(out[k - REACH_STEPS] * 2 if k >= REACH_STEPS else start * _ROOTS[k])
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
    """
    low, high = cubes[:, :3], cubes[:, 3:]
    if streaming is None:
        return Boxes(low, high)
    side = high - low
    part = side / 256
    reach = np.where(streaming.reach > 0, side[:, 0] * _REACHES[streaming.reach], 0.0)
    out = (REACH_SHARE * reach)[:, None]
    return Boxes(low + part * streaming.low - out, low + part * (streaming.high.astype(np.float64) + 1) + out)


def solid_angle(boxes: Boxes, eye: F64) -> F64:
    """(T,) float64 solid angle that boxes take up, seen from `eye` (3,): their projected area by squared distance.

    A box that `eye` is in, or next to, takes up the whole sphere.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        return _project(boxes.half, np.abs(boxes.middle - eye))


def _project(half: F64, away: F64) -> F64:
    squared = away[:, 0] * away[:, 0] + away[:, 1] * away[:, 1] + away[:, 2] * away[:, 2]
    distance = np.sqrt(squared)
    area = away[:, 0] * half[:, 1] * half[:, 2] + away[:, 1] * half[:, 0] * half[:, 2]
    area = 4 * (area + away[:, 2] * half[:, 0] * half[:, 1])
    inside = (away[:, 0] <= half[:, 0]) & (away[:, 1] <= half[:, 1]) & (away[:, 2] <= half[:, 2])
    # Worlds as large as numbers go make infinities, and no number of two of them: such boxes count as near.
    near = inside | ~(area < FULL_SPHERE * squared * distance)
    return np.where(near, FULL_SPHERE, np.where(near, 0.0, area) / np.where(near, 1.0, squared * distance))


def tangent(angle: float) -> float:
    """The tangent of an angle of 0 to below a right angle, by divisions alone: libraries round it differently."""
    squared = angle * angle
    below = 2.0 * _TERMS + 1
    for term in range(_TERMS, 0, -1):
        below = (2 * term - 1) - squared / below
    return angle / below


def share_in_picture(boxes: Boxes, camera: Camera) -> F64:
    """(T,) float64 share of each of T boxes that is in the picture and its margin, of 64 sample places in it.

    Args:
        boxes: of T tiles.
        camera: to look with, from where it will be.
    """
    forward, right, up = camera_axes(camera)
    tall = MARGIN * tangent(camera.fov_y / 2)
    wide = tall * (camera.width / camera.height)
    away, half = boxes.middle - camera.position_ahead, boxes.half
    inside = np.zeros(len(half))
    for a, b, c in itertools.product(SAMPLES, SAMPLES, SAMPLES):
        x, y, z = away[:, 0] + a * half[:, 0], away[:, 1] + b * half[:, 1], away[:, 2] + c * half[:, 2]
        deep, across, high = ((x * axis[0] + y * axis[1] + z * axis[2]) for axis in (forward, right, up))
        inside += (deep > 0) & (np.abs(across) <= wide * deep) & (np.abs(high) <= tall * deep)
    return np.asarray(inside / 64)


def meets_picture(boxes: Boxes, camera: Camera) -> NDArray[np.bool_]:
    """(T,) bool: False only for boxes that are wholly beyond one of the four sides of the picture, or behind the eye.

    Args:
        boxes: of T tiles.
        camera: to look with, from where it will be.
    """
    forward, right, up = (np.array(axis) for axis in camera_axes(camera))
    tall = MARGIN * tangent(camera.fov_y / 2)
    wide = tall * (camera.width / camera.height)
    inwards = [forward, wide * forward + right, wide * forward - right, tall * forward + up, tall * forward - up]
    away, half = boxes.middle - camera.position_ahead, boxes.half
    # The corner of a box that is furthest inwards of a side decides.
    return np.asarray(np.all([away @ normal + half @ np.abs(normal) > 0 for normal in inwards], axis=0))


def camera_axes(camera: Camera) -> tuple[list[float], list[float], list[float]]:
    """Unit vectors forward, to the right and up, of three numbers each."""
    forward = _unit(camera.forward)
    right = _unit(_cross(forward, camera.up))
    return forward, right, _cross(right, forward)


def _unit(vector: F64 | list[float]) -> list[float]:
    x, y, z = (float(v) for v in vector)
    length = float(np.sqrt(x * x + y * y + z * z))
    return [x / length, y / length, z / length]


def _cross(a: list[float] | F64, b: list[float] | F64) -> list[float]:
    (ax, ay, az), (bx, by, bz) = ((float(x) for x in v) for v in (a, b))
    return [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx]
