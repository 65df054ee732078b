"""Views along recorded motions of heads, put into our scenes: paths that no constant was chosen by."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.scenes import DATA
from scarfmt.arrays import F64
from scarfmt.render.camera import Camera, look_at
from scarfmt.render.viewpoints import Surroundings

MOTIONS = DATA / "motion"
WIDTH, HEIGHT, FOV_DEG = 224, 168, 60.0
_MOVES, _LOOKS = 0.5, 0.5
"""How far a path leads from its start, and what is looked at from the middle, at most, radii of the scene."""
_STARTS_AWAY, _STARTS_ABOVE = 1.1, 10.0


@dataclass(frozen=True)
class Motion:
    """A recording.

    Attributes:
        name: of its file.
        seconds: (n,) float64, from 0.
        places: (n, 3) float64 from where it began, right, up, back; the farthest one away.
        looks: (n, 3) float64 change of the unit vector along the line of sight, likewise.
    """

    name: str
    seconds: F64
    places: F64
    looks: F64

    @classmethod
    def read(cls, path: Path) -> Motion:
        """A recording of `DATA`/motion: milliseconds, place, quaternion x y z w."""
        with path.open(newline="") as lines:
            rows = np.array([[float(value) for value in row] for row in list(csv.reader(lines))[1:]])
        x, y, z, w = rows[:, 4:].T
        # What a rotation makes of (0, 0, -1).
        looks = -np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=1)
        places = rows[:, 1:4] - rows[0, 1:4]
        farthest = float(np.linalg.norm(places, axis=1).max()) or 1.0
        return cls(path.stem, rows[:, 0] / 1000, places / farthest, looks - looks[0])


def motions() -> list[Motion]:
    """All recordings, none where there is no `DATA`."""
    return [Motion.read(path) for path in sorted(MOTIONS.glob("*.csv"))]


def starts(around: Surroundings, given: Sequence[Camera], count: int) -> list[F64]:
    """(3,) places to begin at: evenly among poses of photos that were held out, or about the scene."""
    if given:
        return [given[number * len(given) // count].centre for number in range(count)]
    return [
        around.middle + _STARTS_AWAY * around.radius * around.direction(number / count, _STARTS_ABOVE)
        for number in range(count)
    ]


def views(motion: Motion, start: F64, around: Surroundings, count: int) -> list[Camera]:
    """`count` views of a motion that begins at `start`, evenly through its time, the first a little after its start."""
    parts = (motion.seconds[-1] * (number + 0.5) / count for number in range(count))
    rows = (int(np.searchsorted(motion.seconds, seconds)) for seconds in parts)
    return [view_at(motion, start, around, float(motion.seconds[row])) for row in rows]


def view_at(motion: Motion, start: F64, around: Surroundings, seconds: float) -> Camera:
    """The view at a moment of a motion that begins at `start`; between two rows of a recording by a line."""
    up = around.axes[2]
    back = start - around.middle - ((start - around.middle) @ up) * up
    back = back / np.linalg.norm(back)
    axes = np.stack([np.cross(up, back), up, back])
    place, look = (
        np.array([np.interp(seconds, motion.seconds, values[:, axis]) for axis in range(3)])
        for values in (motion.places, motion.looks)
    )
    eye = start + _MOVES * around.radius * (place @ axes)
    target = around.middle + _LOOKS * around.radius * (look @ axes)
    return look_at(eye, target, up, WIDTH, HEIGHT, FOV_DEG, f"{motion.name} {seconds:.0f} s")
