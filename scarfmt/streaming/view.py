"""The view that is planned for: where the camera will be, and what of the tiles it will have in its picture."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from scarfmt.arrays import F64
from scarfmt.streaming.boxes import Boxes

AHEAD_SECONDS = 0.5
"""How far ahead a moving camera is planned for."""
MARGIN = 1.1
"""How much wider than the picture is planned for: cameras turn."""
GRID = (-0.75, -0.25, 0.25, 0.75)
"""Places along each side of a box, in halves of it, that stand for what is in it."""
_TERMS = 25
"""Terms of the continued fraction of the tangent. It is exact up to rounding below a right angle."""


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
    def soon(self) -> F64:
        """(3,) where the eye will be."""
        return self.position if self.velocity is None else self.position + AHEAD_SECONDS * self.velocity


def tangent(angle: float) -> float:
    """The tangent of an angle of 0 to below a right angle, by divisions alone: libraries round it differently."""
    squared = angle * angle
    below = 2.0 * _TERMS + 1
    for term in range(_TERMS, 0, -1):
        below = (2 * term - 1) - squared / below
    return angle / below


def share_in_picture(boxes: Boxes, camera: Camera, margin: float = MARGIN) -> F64:
    """(T,) float64 which part of each box is in the picture, of 64 places in it that are looked at.

    Args:
        boxes: of T tiles.
        camera: to look with, from where it will be.
        margin: how much wider than the picture counts.
    """
    forward, right, up = axes_of(camera)
    tall = margin * tangent(camera.fov_y / 2)
    wide = tall * (camera.width / camera.height)
    away, half = boxes.middle - camera.soon, boxes.half
    seen = np.zeros(len(half))
    for a, b, c in itertools.product(GRID, GRID, GRID):
        x, y, z = away[:, 0] + a * half[:, 0], away[:, 1] + b * half[:, 1], away[:, 2] + c * half[:, 2]
        deep, across, high = ((x * axis[0] + y * axis[1] + z * axis[2]) for axis in (forward, right, up))
        seen += (deep > 0) & (np.abs(across) <= wide * deep) & (np.abs(high) <= tall * deep)
    return np.asarray(seen / 64)


def axes_of(camera: Camera) -> tuple[list[float], list[float], list[float]]:
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
