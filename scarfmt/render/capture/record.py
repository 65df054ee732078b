"""The values of one camera in a file, each checked as it is read, and the camera they make.

Two lists of cameras in JSON need no more than that: this project's, and INRIA's `cameras.json`.

This project's is ``{"images": [{name, W, H, fx, fy, cx, cy, world_to_camera, split}]}`` with OpenCV axes; `name` and
`split` are optional. INRIA's trainer writes, beside a scene, ``[{id, img_name, width, height, position, rotation, fx,
fy}]``: where the eye is, and the rows of the rotation from camera to world. It names no principal point, which is the
middle unless another program has added `cx` and `cy`, and does not tell test from training cameras.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from scarfmt.arrays import F64
from scarfmt.errors import InvalidInput
from scarfmt.render.camera import Camera


@dataclass(frozen=True)
class Distorted:
    """A view through a lens of COLMAP's models.

    Attributes:
        model: its name, e.g. ``"OPENCV"``.
        parameters: in COLMAP's order.
        width, height: of the photo, pixels.
        world_to_camera: (4, 4) float64, OpenCV axes.
        name: of the photo.
        split: ``"train"``, ``"test"`` or empty.
    """

    model: str
    parameters: tuple[float, ...]
    width: int
    height: int
    world_to_camera: F64
    name: str
    split: str = ""


MAX_LISTING_BYTES = 1 << 28
"""Maximum bytes of a file that is read as a whole: about a million cameras."""
MAX_CAMERAS = 1 << 20
MAX_PIXELS_WIDE = 1 << 16
_FAR = 1e12
"""World units or pixels: beyond, squares of such numbers leave binary32."""
_ROTATION_TOLERANCE = 1e-3
"""Tolerance of any element of R R^T. Files hold six digits or more."""
_ROW_TOLERANCE = 1e-5
"""Of a last row that was computed in binary32."""
EXPORT_AGAIN = "export the cameras again"


def wrong(file: str, message: str, field: str | None = None) -> InvalidInput:
    """The error for a camera file that cannot be used: ``input-cameras``.

    Args:
        message: what is wrong, and what to do about it.
    """
    return InvalidInput("input-cameras", f"{file}: {message}", field=field)


@dataclass(frozen=True)
class Record:
    """Named values of one camera, which know their place so that faults can name it.

    Attributes:
        file: path of the file.
        place: where in it, e.g. ``"frames[3]"``.
        values: as read, none checked.
    """

    file: str
    place: str
    values: dict[str, Any]

    @staticmethod
    def of(file: str, place: str, value: object) -> Record:
        """The record of a JSON value.

        Raises:
            InvalidInput: ``input-cameras``: it is no object.
        """
        if not isinstance(value, dict):
            raise wrong(file, f"a camera has to be a JSON object; {EXPORT_AGAIN}", place)
        return Record(file, place, value)

    def fault(self, key: str, message: str) -> InvalidInput:
        """The error for the value of `key`."""
        return wrong(self.file, message, f"{self.place}.{key}")

    def number(self, key: str, default: float | None = None) -> float:
        """A finite number; `default` where there is none.

        Raises:
            InvalidInput: ``input-cameras``: missing without a default, no number, or not within 10^12.
        """
        value = self.values.get(key, default)
        if value is None:
            raise self.fault(key, f"{key} is missing; {EXPORT_AGAIN}")
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= _FAR:
            raise self.fault(key, f"{key} is {_show(value)}, not a finite number; {EXPORT_AGAIN}")
        return float(value)

    def positive(self, key: str, default: float | None = None) -> float:
        """A number above 0, e.g. a focal length.

        Raises:
            InvalidInput: ``input-cameras``.
        """
        value = self.number(key, default)
        if not value > 0:
            raise self.fault(key, f"{key} is {value:g} and has to be above 0; {EXPORT_AGAIN}")
        return value

    def pixels(self, key: str) -> int:
        """Width or height of a picture.

        Raises:
            InvalidInput: ``input-cameras``: not an integer of 1 to 65536.
        """
        value = self.positive(key)
        if value != round(value) or value > MAX_PIXELS_WIDE:
            raise self.fault(key, f"{key} is {value:g}, not 1 to {MAX_PIXELS_WIDE} whole pixels; {EXPORT_AGAIN}")
        return round(value)

    def text(self, key: str) -> str:
        """A text; empty where there is none."""
        return str(self.values.get(key, ""))[:4096]

    def numbers(self, key: str, *shape: int) -> F64:
        """Finite numbers of a shape.

        Raises:
            InvalidInput: ``input-cameras``.
        """
        value = self.values.get(key)
        try:
            array = np.array(value, dtype=np.float64)
        except (TypeError, ValueError, OverflowError, RecursionError):
            array = np.array(np.nan)
        if array.shape != shape or not (np.abs(array) <= _FAR).all():
            size = " x ".join(map(str, shape))
            raise self.fault(key, f"{key} has to be {size} finite numbers; {EXPORT_AGAIN}")
        return array

    def affine(self, key: str) -> F64:
        """(4, 4) float64 of 4 x 4 or 3 x 4 numbers, the last row 0 0 0 1.

        Raises:
            InvalidInput: ``input-cameras``.
        """
        value = self.values.get(key)
        rows = 3 if isinstance(value, list) and len(value) == 3 else 4
        matrix = np.eye(4)
        matrix[:rows] = self.numbers(key, rows, 4)
        if not np.allclose(matrix[3], (0, 0, 0, 1), rtol=0, atol=_ROW_TOLERANCE):
            raise self.fault(key, f"the last row of {key} has to be 0 0 0 1; is the matrix transposed?")
        matrix[3] = 0, 0, 0, 1
        return matrix

    def camera(
        self,
        key: str,
        pose: F64,
        size: tuple[int, int],
        focal: tuple[float, float],
        centre: tuple[float, float],
        name: str,
        split: str = "",
    ) -> Camera:
        """The camera of checked values.

        Args:
            key: where `pose` was read.
            pose: (4, 4) float64, world to camera, OpenCV axes.
            size: width and height, pixels.
            focal: fx and fy, pixels, above 0.
            centre: principal point, pixels.
            split: ``"train"``, ``"test"`` or empty.

        Raises:
            InvalidInput: ``input-cameras``: the pose does not turn and move alone.
        """
        self.check_rotation(key, pose[:3, :3])
        return Camera(*size, *focal, *centre, pose, name, split)

    def check_rotation(self, key: str, rotation: F64) -> None:
        """Refuse a (3, 3) matrix that scales, shears or mirrors.

        Raises:
            InvalidInput: ``input-cameras``.
        """
        if not np.allclose(rotation @ rotation.T, np.eye(3), rtol=0, atol=_ROTATION_TOLERANCE):
            raise self.fault(key, f"{key} scales or shears: a camera's has to be a rotation; {EXPORT_AGAIN}")
        if np.linalg.det(rotation) < 0:
            raise self.fault(key, f"{key} mirrors: one axis of the camera points the wrong way; {EXPORT_AGAIN}")


def how_to_draw(model: str, otherwise: str) -> str:
    """Why a lens of COLMAP's models cannot be drawn, and what to give: `otherwise`, but for panoramas."""
    advice = "cut the panoramas into pinhole views, and give these" if model == "EQUIRECTANGULAR" else otherwise
    return f"lenses of model {model} cannot be drawn; {advice}"


def invert(pose: F64) -> F64:
    """The (4, 4) inverse of a rotation and translation."""
    inverse = np.eye(4)
    inverse[:3, :3] = pose[:3, :3].T
    inverse[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
    return inverse


def focal_of_angle(angle: float, pixels: int) -> float:
    """Focal length in pixels of a field of view of `angle` radians, 0 to pi, over so many pixels."""
    return pixels / (2 * math.tan(angle / 2))


def _show(value: object) -> str:
    return repr(value)[:40]


def own_camera(record: Record) -> Camera:
    """A camera of this project's list.

    Raises:
        InvalidInput: ``input-cameras``.
    """
    split = record.text("split")
    if split not in ("", "train", "test"):
        raise record.fault("split", f'split is {split[:40]!r}: "train", "test" and "" are known')
    size = record.pixels("W"), record.pixels("H")
    focal = record.positive("fx"), record.positive("fy")
    centre = record.number("cx"), record.number("cy")
    pose = record.affine("world_to_camera")
    return record.camera("world_to_camera", pose, size, focal, centre, record.text("name"), split)


def inria_camera(record: Record) -> Camera:
    """A camera of INRIA's list.

    Raises:
        InvalidInput: ``input-cameras``.
    """
    width, height = record.pixels("width"), record.pixels("height")
    focal = record.positive("fx"), record.positive("fy")
    camera_to_world = np.eye(4)
    camera_to_world[:3, :3] = record.numbers("rotation", 3, 3)
    camera_to_world[:3, 3] = record.numbers("position", 3)
    centre = record.number("cx", width / 2), record.number("cy", height / 2)
    pose = invert(camera_to_world)
    return record.camera("rotation", pose, (width, height), focal, centre, record.text("img_name"))
