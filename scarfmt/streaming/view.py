"""The view that is planned for: where the camera will be, and which tiles it will have in its picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scarfmt.arrays import F64, Bools
from scarfmt.streaming.boxes import Boxes

AHEAD_SECONDS = 0.5
"""How far ahead a moving camera is planned for."""
MARGIN = 1.1
"""How much wider than the picture is planned for: cameras turn."""
_TERMS = 25
"""Of the continued fraction of the tangent: exact to the last bit below a right angle, but for rounding."""


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


def in_picture(boxes: Boxes, camera: Camera) -> Bools:
    """(T,) whether some of a box may be in the picture, a margin about it included: none of its sides keeps it out."""
    forward = _unit(camera.forward)
    right = _unit(_cross(forward, camera.up))
    up = _cross(right, forward)
    tall = MARGIN * tangent(camera.fov_y / 2)
    wide = tall * (camera.width / camera.height)
    away, half = boxes.middle - camera.soon, boxes.half
    seen: Bools = np.ones(len(half), np.bool_)
    sides = [[r + wide * f for r, f in zip(s, forward, strict=True)] for s in (right, [-r for r in right])]
    sides += [[u + tall * f for u, f in zip(s, forward, strict=True)] for s in (up, [-u for u in up])]
    for side in (forward, *sides):
        most = away[:, 0] * side[0] + away[:, 1] * side[1] + away[:, 2] * side[2]
        most = most + (half[:, 0] * abs(side[0]) + half[:, 1] * abs(side[1]) + half[:, 2] * abs(side[2]))
        seen &= most >= 0
    return seen


def _unit(vector: F64 | list[float]) -> list[float]:
    x, y, z = (float(v) for v in vector)
    length = float(np.sqrt(x * x + y * y + z * z))
    return [x / length, y / length, z / length]


def _cross(a: list[float] | F64, b: list[float] | F64) -> list[float]:
    (ax, ay, az), (bx, by, bz) = ((float(x) for x in v) for v in (a, b))
    return [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx]
