"""Views from everywhere a viewer may stand: drawn by a seed, of three kinds, the same on every machine.

    orbit    from outside, 1.2 to 4 radii away, any direction, looking about the middle
    near     the subject fills the picture: 0.5 to 1.2 radii away, or 0.1 to 0.6 from some piece of the scene
    inside   standing within the core, looking outwards, mostly level

A radius is half the diagonal of the 10-90 % box of the positions (:func:`scarfmt.render.camera.core`). Views of one
seed fill their space evenly; views of two seeds have nothing in common but the distribution.

The up direction of a scene that does not state it is found from its Gaussians. Most scenes are upright along -y, as
capture software leaves them, so another axis needs strong evidence: floors, tables and paving are large flat Gaussians
that all face up, the core is wide and low, and what is flat lies below its middle.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from scarfmt.arrays import F64
from scarfmt.container.morton import MAX_BITS, interleave
from scarfmt.render.camera import AUTO, NEAR, Arc, Camera, core, find_subject, look_at, upward_axes
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.scene.rotation import matrix_from_quaternion

USUAL = "-y"
_SAMPLE = 50_000
_Y = 1
_FLAT = 0.3
"""Maximum of the shortest axis, as a share of the middle axis, of a Gaussian that has a face."""
_FACING = 0.9
"""Cosine between the normal of a face and the axis it counts for."""
_CLEARLY, _HARDLY = 6.0, 1.5
"""How many times more faces a level axis has than either other axis."""
_LOW, _LOWER = 0.8, 0.35
"""Height of a core that lies level, of its lesser width."""
_UPSIDE_DOWN, _DOUBTFUL = 0.5, 0.25
"""How far below the middle what shows and what lies level are, together, in heights of the core."""


@dataclass(frozen=True)
class Upright:
    """The up direction of a scene.

    Attributes:
        up: a frame (:class:`Arc`).
        other: the next best guess where it is doubtful, else None.
        given: whether somebody said so.
    """

    up: str
    other: str | None = None
    given: bool = False


def resolve_frame(scene: GaussianScene, frame: str) -> Upright:
    """The up direction that `frame` names; for :data:`AUTO`, the one the scene is described by, or else found in it."""
    named = scene.description.up_axis if frame == AUTO else frame
    return upright(scene) if named is None else Upright(named, given=True)


def upright(scene: GaussianScene) -> Upright:
    """The probable up direction of a scene."""
    faces = _Faces.of(scene)
    if faces is None:
        return Upright(USUAL)
    level = int(faces.share.argmax())
    if level != _Y:
        found = ("" if faces.weight[level] < 0 else "-") + "xyz"[level]
        more = faces.share[level] / max(np.delete(faces.share, level).max(), 1e-300)
        low = faces.extent[level] / max(np.delete(faces.extent, level).min(), 1e-300)
        if more > _CLEARLY and low < _LOW:
            return Upright(found)
        if more > _HARDLY and low < _LOWER:
            return Upright(found, USUAL)
    # Along +y lies what is below, if -y is up.
    if -faces.weight[_Y] > _UPSIDE_DOWN:
        return Upright("y", USUAL)
    return Upright(USUAL, "y" if -faces.weight[_Y] > _DOUBTFUL else None)


@dataclass(frozen=True)
class _Faces:
    """The evidence for an axis; each array is (3,) float64.

    Attributes:
        share: of the area that shows, what faces along it.
        extent: of the core.
        weight: how far from the middle of the core, towards its positive end, what faces along it and all that shows
            are, together; in extents.
    """

    share: F64
    extent: F64
    weight: F64

    @staticmethod
    def of(scene: GaussianScene) -> _Faces | None:
        """The evidence of a sample of the Gaussians around the core; None if none of them is visible."""
        part = scene.take(np.arange(0, len(scene), max(1, -(-len(scene) // _SAMPLE))))
        part = part.take(np.flatnonzero(find_subject(part.positions)))
        if not len(part):
            return None
        low, middle, high = np.percentile(part.positions, [10, 50, 90], axis=0)
        extent = np.maximum(high - low, 1e-300)
        part = part.take(np.flatnonzero((np.abs(part.positions - middle) <= extent + (high - low) / 2).all(axis=1)))
        scales = np.sort(part.log_scales.astype(np.float64), axis=1)
        area = np.exp(scales[:, 1] + scales[:, 2]) / (1 + np.exp(-part.opacity_logits.astype(np.float64)))
        area = np.minimum(area, np.percentile(area, 99)) if len(area) else area
        if not area.sum() > 0:
            return None
        shortest = part.log_scales.argmin(axis=1)
        normals = matrix_from_quaternion(part.rotations)[np.arange(len(part)), :, shortest]
        flat = scales[:, 0] - scales[:, 1] < np.log(_FLAT)
        faces = (area * flat)[:, None] * (np.abs(normals) > _FACING)
        place = (part.positions - middle) / extent
        share = faces.sum(axis=0)
        level = (faces * place).sum(axis=0) / np.maximum(share, 1e-300)
        centre = (low + high) / 2
        shown = area @ ((part.positions - centre) / extent) / area.sum()
        return _Faces(share / area.sum(), extent, level + shown)


WIDTH, HEIGHT, FOV_DEG = 640, 480, 60.0
_NEAR_PART = 0.05
_CELL_PART = 0.1
"""Side of the cells that near views are spread over, radii."""
_AIM = 0.5
"""How far from the middle, in half extents, a view looks at most."""


@dataclass(frozen=True)
class Surroundings:
    """The known properties of a scene before any view is drawn.

    Attributes:
        middle: (3,) float64, of the core.
        half: (3,) float64 half extents of the core.
        axes: (3, 3) float64 rows: azimuth 0, azimuth 90 degrees, up.
        places: (n, 3) float64 pieces of the scene that near views look at, neighbours side by side.
        arc: azimuths (degrees) that eyes outside stay within.
    """

    middle: F64
    half: F64
    axes: F64
    places: F64
    arc: Arc

    @staticmethod
    def of(scene: GaussianScene, frame: str) -> Surroundings:
        """The properties of a scene, with the up axis and arc of `frame`; for :data:`AUTO`, those found in the scene.

        Raises:
            InvalidInput: ``input-frame``; ``input-empty`` if no position is finite.
        """
        arc = Arc.parse(resolve_frame(scene, frame).up)
        axes = upward_axes(arc.up)
        middle, half = core(scene, axes[2])
        places = choose_occupied(scene.positions[find_subject(scene.positions)], float(np.linalg.norm(half)))
        return Surroundings(middle, half, axes, places, arc)

    @property
    def radius(self) -> float:
        """Half the diagonal of the core, world units; 1 for a scene of one point."""
        return float(np.linalg.norm(self.half)) or 1.0

    def direction(self, turn: float, elevation_deg: float) -> F64:
        """(3,) unit vector `turn` (0..1) through the arc, so many degrees above the horizon."""
        azimuth = math.radians(self.arc.centre_deg + (turn - 0.5) * self.arc.span_deg)
        elevation = math.radians(elevation_deg)
        level = math.cos(azimuth) * self.axes[0] + math.sin(azimuth) * self.axes[1]
        return np.asarray(math.cos(elevation) * level + math.sin(elevation) * self.axes[2])

    def camera(self, eye: F64, target: F64, name: str) -> Camera:
        """The view from `eye` towards `target`."""
        return look_at(eye, target, self.axes[2], WIDTH, HEIGHT, FOV_DEG, name, min(NEAR, _NEAR_PART * self.radius))


def choose_occupied(positions: F64, radius: float) -> F64:
    """(n, 3) some of the (N, 3) positions, in Morton order: of a cell that holds many, about the square root of that.

    Evenly spaced among these, a few reach every region, and crowded ones more often.
    """
    side = _CELL_PART * radius or 1.0
    low = np.percentile(positions, 1, axis=0) - side
    cells = np.clip((positions - low) / side, 0, (1 << MAX_BITS) - 1).astype(np.uint64)
    codes = interleave(cells)
    order = np.argsort(codes, kind="stable")
    first = np.flatnonzero(np.diff(codes[order], prepend=codes[order[:1]] + np.uint64(1)))
    held = np.diff(np.append(first, len(order)))
    taken = np.ceil(np.sqrt(held)).astype(np.int64)
    # The k-th of those taken from a cell that holds h: the first, and then every so many-th.
    rank = np.arange(taken.sum()) - np.repeat(np.cumsum(taken) - taken, taken)
    return np.asarray(positions[order[np.repeat(first, taken) + rank * np.repeat(held // taken, taken)]])


def _orbit(around: Surroundings, u: F64) -> tuple[F64, F64]:
    distance = 1.2 * (4 / 1.2) ** float(u[0])
    # Even over the upper part of the sphere: sin(elevation) uniform from -0.3 to 1.
    elevation = math.degrees(math.asin(-0.3 + 1.3 * float(u[2])))
    target = around.middle + _AIM * 0.6 * around.half * (2 * u[3:6] - 1)
    return around.middle + distance * around.radius * around.direction(float(u[1]), elevation), target


def _near(around: Surroundings, u: F64) -> tuple[F64, F64]:
    elevation = math.degrees(math.asin(-0.3 + 1.2 * float(u[2])))
    towards = around.direction(float(u[1]), elevation)
    if u[6] < 0.5:
        distance = 0.5 + 0.7 * float(u[0])
        return around.middle + distance * around.radius * towards, around.middle + _AIM * around.half * (2 * u[3:6] - 1)
    piece = around.places[min(int(u[3] * len(around.places)), len(around.places) - 1)]
    distance = 0.1 * 6 ** float(u[0])
    return piece + distance * around.radius * towards, piece


def _inside(around: Surroundings, u: F64) -> tuple[F64, F64]:
    spread = (2 * u[3:6] - 1) * around.half
    vertical = np.abs(around.axes[2])
    low_high = around.middle + spread * (1 - vertical) + 0.6 * spread * vertical
    # An eye inside an arc looks the way those outside do.
    elevation = -20 + 40 * float(u[2])
    away = (
        -around.direction(float(u[1]), elevation)
        if around.arc.span_deg < 360
        else around.direction(float(u[1]), elevation)
    )
    return low_high, low_high + around.radius * away


KINDS: dict[str, Callable[[Surroundings, F64], tuple[F64, F64]]] = {"orbit": _orbit, "near": _near, "inside": _inside}
"""Kind -> (where, numbers (7,) in 0..1) -> eye and target."""


def even_numbers(count: int, dimensions: int, seed: int) -> F64:
    """(count, dimensions) float64 in 0..1 that fill the cube evenly: an additive recurrence, shifted by the seed.

    Its steps are the powers of 1 / phi_d, the generalised golden ratio.
    """
    phi = 2.0
    for _ in range(60):
        phi = (1 + phi) ** (1 / (dimensions + 1))
    steps = phi ** -np.arange(1.0, dimensions + 1)
    shift = np.random.default_rng(seed).random(dimensions)
    return np.asarray((shift + np.arange(1, count + 1)[:, None] * steps) % 1)


def viewpoints(around: Surroundings, kind: str, count: int, seed: int) -> list[Camera]:
    """`count` views of 640x480 pixels of a kind, one of :data:`KINDS`."""
    numbers = even_numbers(count, 7, seed)
    made = (KINDS[kind](around, u) for u in numbers)
    return [around.camera(eye, target, f"{kind} {number}") for number, (eye, target) in enumerate(made, 1)]


def beside(cameras: Sequence[Camera], distance: float, degrees: float, seed: int) -> list[Camera]:
    """A view beside each camera: the eye up to `distance` away along each axis, and turned by up to `degrees`."""
    made = []
    for camera, u in zip(cameras, 2 * even_numbers(len(cameras), 6, seed) - 1, strict=True):
        pose = camera.world_to_camera.copy()
        pose[:3, :3] = _turn(np.radians(degrees) * u[3:6]) @ pose[:3, :3]
        pose[:3, 3] = -pose[:3, :3] @ (camera.centre + distance * u[:3])
        made.append(replace(camera, world_to_camera=pose, name=f"beside {camera.name}"))
    return made


def _turn(angles: F64) -> F64:
    """(3, 3) rotation by `angles` (3,) about the axes, one after another."""
    turned = np.eye(3)
    for axis, angle in enumerate(angles):
        step = np.eye(3)
        a, b = (axis + 1) % 3, (axis + 2) % 3
        step[a, a] = step[b, b] = math.cos(angle)
        step[a, b], step[b, a] = -math.sin(angle), math.sin(angle)
        turned = step @ turned
    return turned
