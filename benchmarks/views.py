"""The fixed views that every figure of quality comes from: forty of three kinds, and the cameras of the capture.

    orbit     from 1.8 radii at 18 degrees, from 4 radii at 25, from 1.8 radii at 65: four views each
    near      from 1.0 radii at 12 degrees, from 0.6 at 10: four views each
    inside    from the middle outwards, level, and from higher up, looking down: four views each; walking: twelve
    capture   the cameras of the photos that are held out, where there are any

A radius is half the diagonal of the 10-90 % box of the positions. This module shares no code with the views that the
encoder draws: neither its survey nor its rate control has seen these. Views that show nothing are left out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import NamedTuple

import numpy as np

from scarfmt.arrays import F32, F64
from scarfmt.cli.scenes import Subject
from scarfmt.render.camera import NEAR, Camera, core, look_at, upward_axes
from scarfmt.scene.gaussians import GaussianScene

KINDS = ("orbit", "near", "inside", "capture")
WIDTH, HEIGHT, FOV_DEG = 320, 240, 60.0
WALKING = 12
_NEAR_PART = 0.05
_SEED = 20261122
_DRAWN = 60
"""Walking views looked at for twelve that show something."""
_LIT, _LIT_SHARE = 2 / 255, 0.05
"""A view shows something if this share of its pixels has a channel brighter than this."""


class View(NamedTuple):
    """A camera, and which of :data:`KINDS` it is of."""

    kind: str
    camera: Camera


RINGS = (
    ("orbit", 1.8, 18, 0.06),
    ("near", 1.0, 12, 0.17),
    ("near", 0.6, 10, 0.21),
    ("orbit", 4.0, 25, 0.14),
    ("orbit", 1.8, 65, 0.09),
)
"""(kind, radii away, elevation in degrees, turn of the first, 0..1 of a circle) of four cameras each that look at the
middle."""
OUTWARDS = ((0.0, 0.0, 0.03), (0.15, -12.0, 0.16))
"""(radii above the middle, elevation in degrees, turn of the first) of four views outwards each."""


@dataclass(frozen=True)
class Space:
    """The core of a scene: (3,) float64 middle and half extents, (3, 3) axes (azimuth 0, azimuth 90 degrees, up)."""

    middle: F64
    half: F64
    axes: F64

    @property
    def radius(self) -> float:
        return float(np.linalg.norm(self.half)) or 1.0

    def towards(self, turn: float, elevation_deg: float) -> F64:
        """(3,) unit vector."""
        azimuth, elevation = 2 * math.pi * turn, math.radians(elevation_deg)
        level = math.cos(azimuth) * self.axes[0] + math.sin(azimuth) * self.axes[1]
        return np.asarray(math.cos(elevation) * level + math.sin(elevation) * self.axes[2])

    def camera(self, eye: F64, target: F64, name: str) -> Camera:
        near = min(NEAR, _NEAR_PART * self.radius)
        return look_at(eye, target, self.axes[2], WIDTH, HEIGHT, FOV_DEG, name, near)


def make_views(original: Subject, up: str, capture: Sequence[Camera] = ()) -> list[View]:
    """The views of a scene that show something.

    Args:
        original: the source, which remembers its pictures.
        up: which axis points up in the scene.
        capture: cameras of photos that were held out; drawn as wide as all other views.
    """
    space = _space(original.placed, up)
    fixed = [view for view in (*_rings(space), *_outwards(space)) if _shows_something(original.picture(view.camera))]
    walking = (view for view in _walking(space) if _shows_something(original.picture(view.camera)))
    scaled = [View("capture", camera.scale(WIDTH / camera.width)) for camera in capture]
    return [*fixed, *islice(walking, WALKING), *scaled]


def _space(scene: GaussianScene, up: str) -> Space:
    axes = upward_axes(up)
    return Space(*core(scene, axes[2]), axes)


def _rings(space: Space) -> Iterator[View]:
    for kind, radii, elevation, turn in RINGS:
        for number in range(4):
            eye = space.middle + radii * space.radius * space.towards(turn + number / 4, elevation)
            name = f"{radii:g} radii, {elevation:g} degrees, {number + 1}"
            yield View(kind, space.camera(eye, space.middle, name))


def _outwards(space: Space) -> Iterator[View]:
    for height, elevation, turn in OUTWARDS:
        eye = space.middle + height * space.radius * space.axes[2]
        for number in range(4):
            target = eye + space.radius * space.towards(turn + number / 4, elevation)
            yield View("inside", space.camera(eye, target, f"outwards, {elevation:g} degrees, {number + 1}"))


def _walking(space: Space) -> Iterator[View]:
    """Cameras anywhere in the core at a third of its height, looking about level."""
    random = np.random.default_rng(_SEED)
    vertical = np.abs(space.axes[2])
    for number in range(_DRAWN):
        place = space.half * (2 * random.random(3) - 1)
        height = -space.half / 3 * space.axes[2]
        eye = space.middle + place * (1 - vertical) + height
        target = eye + space.radius * space.towards(random.random(), random.uniform(-10, 5))
        yield View("inside", space.camera(eye, target, f"walking {number + 1}"))


def _shows_something(picture: F32) -> bool:
    return float((picture.max(axis=2) > _LIT).mean()) >= _LIT_SHARE
