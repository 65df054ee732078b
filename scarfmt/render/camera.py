"""Pinhole cameras, the project's evaluation orbit, and whether cameras and a scene belong together."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from scarfmt.arrays import F64, Bools
from scarfmt.errors import InputWarning, InvalidInput
from scarfmt.scene.gaussians import GaussianScene

# Up axis -> the horizontal axes at azimuth 0 and 90 degrees. Flipping the up axis flips only the second,
# so that a scene turned upside down keeps its azimuths as seen from its own top.
_HORIZON = {
    "x": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "-x": ((-1, 0, 0), (0, 1, 0), (0, 0, -1)),
    "y": ((0, 1, 0), (1, 0, 0), (0, 0, 1)),
    "-y": ((0, -1, 0), (1, 0, 0), (0, 0, -1)),
    "z": ((0, 0, 1), (1, 0, 0), (0, 1, 0)),
    "-z": ((0, 0, -1), (1, 0, 0), (0, -1, 0)),
}
AUTO = "auto"
"""A frame that is to be found out."""
# INRIA's near plane, world units; orbits of scenes smaller than a unit need one that scales with them.
NEAR = 0.2
_NEAR_PART_OF_RADIUS = 0.2
# INRIA's: every splat is widened by as much, pixels^2.
DILATION_PX2 = 0.3
# Part of the distance that would show the whole sphere round the core box: the box's corners are mostly empty.
_FILL = 0.85


@dataclass(frozen=True)
class Camera:
    """A pinhole camera with OpenCV axes: x right, y down, z forward.

    Pixel (column i, row j) has its centre at (i + 0.5, j + 0.5).

    Attributes:
        width, height: picture size, pixels.
        fx, fy, cx, cy: focal lengths and principal point, pixels.
        world_to_camera: (4, 4) float64, x_camera = R x_world + t.
        name: photo file name or a label; may be empty.
        split: ``"train"``, ``"test"`` or empty.
        near: Gaussians whose centre is no further than this in front of the eye are not drawn, world units.
        dilation: variance that the renderer adds to every splat, pixels^2.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    world_to_camera: F64
    name: str = ""
    split: str = ""
    near: float = NEAR
    dilation: float = DILATION_PX2

    @property
    def centre(self) -> F64:
        """(3,) float64 position of the eye, world units."""
        rotation, translation = self.world_to_camera[:3, :3], self.world_to_camera[:3, 3]
        return -rotation.T @ translation

    def scale(self, factor: float) -> Camera:
        """A copy of this view for a picture `factor` times as wide and high, rounded to whole pixels."""
        width, height = max(1, round(self.width * factor)), max(1, round(self.height * factor))
        sx, sy = width / self.width, height / self.height
        fx, fy, cx, cy = self.fx * sx, self.fy * sy, self.cx * sx, self.cy * sy
        return replace(self, width=width, height=height, fx=fx, fy=fy, cx=cx, cy=cy)

    def resize(self, width: int, height: int) -> Camera:
        """A picture of that size with this view's horizontal field, and the principal point in its middle."""
        focal = self.fx * width / self.width
        return replace(self, width=width, height=height, fx=focal, fy=focal, cx=width / 2, cy=height / 2)

    def sample(self, every: int) -> Camera:
        """One pixel of each `every` x `every` of this view, as it is there: splats are as wide as in the whole picture.

        The mean over many such pictures is that over as many whole ones, at a fraction of the time. A picture that is
        :meth:`scale` is another one: its splats are dilated by pixels that are larger.
        """
        smaller = self.scale(1 / every)
        return replace(smaller, dilation=self.dilation * (smaller.width / self.width) ** 2)


@dataclass(frozen=True)
class Arc:
    """The direction that is up, and the azimuths that an orbit covers.

    Attributes:
        up: ``"x"``, ``"-x"``, ``"y"``, ``"-y"``, ``"z"`` or ``"-z"``.
        centre_deg: azimuth of the middle of the arc, degrees.
        span_deg: width of the arc, degrees; 360 is the whole circle.
    """

    up: str
    centre_deg: float = 0.0
    span_deg: float = 360.0

    @staticmethod
    def parse(text: str) -> Arc:
        """Read ``"UP"`` or ``"UP:CENTRE_DEG:SPAN_DEG"``, e.g. ``"-y"`` or ``"-y:125:70"``.

        Raises:
            InvalidInput: the text has another shape, or numbers out of range.
        """
        up, *numbers = text.split(":")
        if up not in _HORIZON:
            raise _frame_fault(text, f"{up!r} is not an axis: use {', '.join(_HORIZON)}")
        if not numbers:
            return Arc(up)
        if len(numbers) != 2:
            raise _frame_fault(text, "an arc has two numbers, its centre and its span: UP:CENTRE_DEG:SPAN_DEG")
        centre, span = (_degrees(text, number) for number in numbers)
        if not 0 <= span <= 360:
            raise _frame_fault(text, f"the span is {span:g} and has to be 0 to 360 degrees")
        return Arc(up, centre, span)

    def azimuths(self, count: int) -> F64:
        """(count,) float64 degrees: evenly round a whole circle, else both ends of the arc included."""
        if self.span_deg == 360 or count == 1:
            return self.centre_deg + np.arange(count, dtype=np.float64) * (self.span_deg / count)
        return self.centre_deg + self.span_deg * np.linspace(-0.5, 0.5, count, dtype=np.float64)


def check_frame(text: str) -> None:
    """Check what an encoder takes for a frame: :data:`AUTO`, or what :meth:`Arc.parse` reads.

    Raises:
        InvalidInput: ``input-frame``.
    """
    if text != AUTO:
        Arc.parse(text)


def _degrees(frame: str, text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise _frame_fault(frame, f"{text!r} is no number of degrees")
    return number


def _frame_fault(text: str, message: str) -> InvalidInput:
    return InvalidInput("input-frame", f"cannot read the frame {text[:80]!r}: {message}; e.g. -y or -y:125:70")


def upward_axes(up: str) -> F64:
    """(3, 3) float64 rows: the horizontal axes at azimuth 0 and 90 degrees, and `up`, one of `Arc.up`."""
    upward, zero, ninety = _HORIZON[up]
    return np.array([zero, ninety, upward], dtype=np.float64)


def look_at(
    eye: F64,
    target: F64,
    up: F64,
    width: int,
    height: int,
    fov_deg: float = 60.0,
    name: str = "",
    near: float = NEAR,
) -> Camera:
    """A camera at `eye` looking at `target`, with `up` pointing up in the picture.

    Args:
        eye, target, up: (3,) float64, world units.
        width, height: picture size, pixels.
        fov_deg: horizontal field of view, degrees.
        near: distance of the near plane, world units.
    """
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, up)
    if np.linalg.norm(right) < 1e-9:
        # Looking straight along the up axis: any horizontal direction will do, but always the same one.
        right = np.cross(forward, np.roll(up, 1))
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    pose[:3, 3] = -pose[:3, :3] @ eye
    focal = width / (2 * math.tan(math.radians(fov_deg) / 2))
    return Camera(width, height, focal, focal, width / 2, height / 2, pose, name, near=near)


def find_subject(positions: F64) -> Bools:
    """(N,) bool: finite positions; where half of them fill next to nothing of the 10-90 % core, as before a wide sky,
    those around this half. Found anew in these, until that holds no more.

    Args:
        positions: (N, 3) float64.
    """
    found = np.flatnonzero(np.isfinite(positions).all(axis=1))
    while len(found) > 1:
        ordered = np.sort(positions[found[:: -(-len(found) // _SUBJECT_SAMPLE)]], axis=0)
        half = len(ordered) // 2
        widths = ordered[half:] - ordered[: len(ordered) - half]
        # The shortest interval on each axis that holds half of the positions.
        first, size = ordered[widths.argmin(axis=0), np.arange(3)], widths.min(axis=0)
        if not 0 < np.linalg.norm(size) < SMALL_PART * np.linalg.norm(np.ptp(np.percentile(ordered, [10, 90], 0), 0)):
            break
        at = positions[found]
        found = found[((at >= first - size) & (at <= first + 2 * size)).all(axis=1)]
    subject = np.zeros(len(positions), np.bool_)
    subject[found] = True
    return subject


def core(scene: GaussianScene, upward: F64) -> tuple[F64, F64]:
    """Middle and half extent, each (3,) float64, of the 10-90 % core of the subject's positions per axis.

    Along the (3,) unit axis `upward` the middle is that of the core, so that a standing subject is not cut off
    at its thinner end; sideways it is the median, which stays with the subject where the background reaches far
    to one side.

    Raises:
        InvalidInput: the scene has no Gaussian at a finite position.
    """
    subject = scene.positions[find_subject(scene.positions)]
    if len(subject) == 0:
        raise InvalidInput("input-empty", "the scene has no Gaussian at a finite position: nothing to look at")
    low, middle, high = np.percentile(subject, [10, 50, 90], axis=0)
    vertical = np.abs(upward)
    return middle * (1 - vertical) + (low + high) / 2 * vertical, (high - low) / 2


def orbit_cameras(
    scene: GaussianScene,
    count: int = 8,
    width: int = 640,
    height: int = 480,
    up: str = "-y",
    elevation_deg: float = 20.0,
    azimuth_offset_deg: float = 0.0,
    radius_factor: float = 1.0,
    fov_deg: float = 60.0,
) -> list[Camera]:
    """Cameras on an orbit round the scene's 10-90 % core, all looking at its middle (:func:`core`).

    Args:
        width, height: picture size, pixels.
        up: ``"UP"`` or an arc ``"UP:CENTRE_DEG:SPAN_DEG"`` (:meth:`Arc.parse`). Azimuths turn from +x
            towards -z for ``-y`` (+z for ``y``), +x towards +y for ``z``.
        elevation_deg: height of the eyes above the horizon of the target, degrees.
        azimuth_offset_deg: added to every azimuth, degrees.
        radius_factor: multiplies the distance; 1 lets the core just fill the picture.
        fov_deg: horizontal field of view, degrees.

    Raises:
        InvalidInput: `up` cannot be read, or the scene is empty.
    """
    arc = Arc.parse(up)
    zero, ninety, upward = upward_axes(arc.up)
    target, half_extent = core(scene, upward)
    half_fov = math.atan(math.tan(math.radians(fov_deg) / 2) * min(1.0, height / width))
    # A scene of one point has no extent; any positive radius shows it.
    extent = float(np.linalg.norm(half_extent)) or 1.0
    radius = radius_factor * _FILL * extent / math.sin(half_fov)
    near = min(NEAR, _NEAR_PART_OF_RADIUS * radius)
    elevation = math.radians(elevation_deg)
    cameras = []
    for azimuth in arc.azimuths(count) + azimuth_offset_deg:
        turn = math.radians(azimuth)
        level = math.cos(turn) * zero + math.sin(turn) * ninety
        eye = target + radius * (math.cos(elevation) * level + math.sin(elevation) * upward)
        label = f"{azimuth % 360:.0f} deg"
        cameras.append(look_at(eye, target, upward, width, height, fov_deg, label, near))
    return cameras


SEEN_AT_LEAST = 0.02
"""Share of the Gaussians that half of the cameras must see. Captures have 59 and 98 %; with axes or world turned, 0 to
3 % [0024]."""
SMALL_PART = 0.15
"""Part of the size of a core that half of a scene fills at least, or the core is that half; ten real scenes: 0.40 to
0.57."""
_SUBJECT_SAMPLE = 65_536
"""Positions that tell where the subject is."""
_POSITIONS, _CAMERAS = 4096, 1024


def part_in_view(positions: F64, cameras: Sequence[Camera]) -> float:
    """The part, 0..1, of (N, 3) float64 positions that half of the cameras have in their pictures, hidden or not.

    An even sample of positions and cameras is looked at.
    """
    sample = positions[:: max(1, len(positions) // _POSITIONS)]
    chosen = cameras[:: max(1, len(cameras) // _CAMERAS)]
    return float(np.median([in_view(sample, camera).mean() if len(sample) else 0.0 for camera in chosen]))


def warn_if_cameras_miss_scene(positions: F64, cameras: Sequence[Camera]) -> None:
    """Warn where half of the cameras have hardly anything in view: most likely they have another frame or scale.

    Args:
        positions: (N, 3) float64, of Gaussians or anchors.
        cameras: at least one.

    Warns:
        InputWarning: half of them have less than 2 % of the positions in their pictures.
    """
    found = part_in_view(positions, cameras)
    if found < SEEN_AT_LEAST:
        message = (
            f"the cameras do not look at the scene: half of the {len(cameras)} have at most {100 * found:.2g} % of it"
            " in view; are they in the frame and scale that the scene was trained in?"
        )
        warnings.warn(message, InputWarning, stacklevel=3)


def warn_if_much_lies_apart(positions: F64) -> None:
    """Warn where most of a scene lies outside of its subject: views that are placed by the core do not come near.

    Args:
        positions: (N, 3) float64, of Gaussians or anchors.

    Warns:
        InputWarning: less than half of the positions belong to the subject (:func:`find_subject`).
    """
    subject = find_subject(positions)
    if subject.mean() < 0.5:
        size = np.linalg.norm(np.ptp(positions[subject], axis=0))
        message = (
            f"the encoder looks at {subject.mean():.0%} of the Gaussians, within {size:.2g} of each other; others lie"
            " far away, and may be lost: give cameras, or encode parts of the scene by themselves"
        )
        warnings.warn(message, InputWarning, stacklevel=3)


def in_view(positions: F64, camera: Camera) -> Bools:
    """(N,) bool: which of (N, 3) float64 positions `camera` has in its picture, hidden or not."""
    seen = positions @ camera.world_to_camera[:3, :3].T + camera.world_to_camera[:3, 3]
    x, y, depth = seen[:, 0], seen[:, 1], seen[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        column, row = camera.fx * x / depth + camera.cx, camera.fy * y / depth + camera.cy
    inside: Bools = (column > 0) & (column < camera.width) & (row > 0) & (row < camera.height) & (depth > camera.near)
    return inside
