"""The viewpoints of gains: a few of the views that matter, spread over all of them (encoder only, informative)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scarfmt.arrays import F64, I64
from scarfmt.render.camera import Camera

_ROUNDS = 20
_LOOKS = 3
"""Views of a group that its eye looks along, at most."""


@dataclass(frozen=True)
class Eye:
    """A place to look from.

    Attributes:
        centre: (3,) float64, world units: where the first of `cameras` stands.
        cameras: views from there or near there, the middle one first.
        share: of all views, those that are nearest to this place.
    """

    centre: F64
    cameras: tuple[Camera, ...]
    share: float


def eyes(cameras: Sequence[Camera], count: int) -> list[Eye]:
    """At most `count` places that stand for all `cameras`, the one that stands for most of them first.

    Groups of like places by k-means, begun with the camera next to the middle and then always the one farthest from
    those taken; of each the camera next to its mean, and some others spread over it, since an eye may turn.
    """
    centres = np.array([camera.centre for camera in cameras])
    starts = _spread(centres, count, int(_distances(centres, centres.mean(axis=0)).argmin()))
    means = centres[starts]
    for _ in range(_ROUNDS):
        group = np.stack([_distances(centres, mean) for mean in means]).argmin(axis=0)
        means = np.stack([centres[group == g].mean(axis=0) if (group == g).any() else m for g, m in enumerate(means)])
    found = [_eye(cameras, centres, np.flatnonzero(group == g), mean) for g, mean in enumerate(means) if g in group]
    return sorted(found, key=lambda eye: -eye.share)


def _eye(cameras: Sequence[Camera], centres: F64, members: I64, mean: F64) -> Eye:
    middle = int(_distances(centres[members], mean).argmin())
    looks = np.array([camera.world_to_camera[2, :3] for camera in (cameras[member] for member in members)])
    taken = [members[number] for number in _spread(looks, _LOOKS, middle)]
    return Eye(centres[members[middle]], tuple(cameras[number] for number in taken), len(members) / len(cameras))


def _spread(points: F64, count: int, first: int) -> list[int]:
    """`first`, and then always the point farthest from those taken; fewer where no other is left."""
    taken = [first]
    nearest = _distances(points, points[first])
    while len(taken) < min(count, len(points)) and nearest.max() > 0:
        taken.append(int(nearest.argmax()))
        nearest = np.minimum(nearest, _distances(points, points[taken[-1]]))
    return taken


def _distances(points: F64, point: F64) -> F64:
    return np.asarray(((points - point) ** 2).sum(axis=1))
