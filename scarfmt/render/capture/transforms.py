"""`transforms.json` of Nerfstudio, Instant-NGP and Blender: poses from camera to world with OpenGL axes.

x points right, y up, z backwards; a camera of OpenCV axes is that with y and z flipped. Intrinsics (`fl_x`, `fl_y`,
`cx`, `cy`, `w`, `h`, `camera_angle_x` and so on) stand in the frame, or above for all of them. One focal length is that
of both axes.

Poses are taken as they stand, which is where trainers that read the file put the scene. Two frames differ from it:

- `ns-process-data` turns COLMAP's frame into the file's by the `applied_transform` it records. A scene trained from the
  COLMAP folder is in COLMAP's: give that folder.
- Nerfstudio's own trainer centres and scales once more, and writes `dataparser_transforms.json`. Beside the file, it is
  applied. It maps from before `applied_transform` and `applied_scale`, so these are taken out of it.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from scarfmt.arrays import F64
from scarfmt.errors import InputWarning, InvalidInput, plural
from scarfmt.render.camera import Camera
from scarfmt.render.capture.record import EXPORT_AGAIN, Distorted, Record, focal_of_angle, how_to_draw, invert

DATAPARSER = "dataparser_transforms.json"
PINHOLE_MODELS = ("", "PINHOLE", "SIMPLE_PINHOLE", "OPENCV", "SIMPLE_RADIAL", "RADIAL", "FULL_OPENCV")
_FISHEYE = "OPENCV_FISHEYE"
_DISTORTIONS = ("k1", "k2", "k3", "k4", "p1", "p2")
_ALL_DISTORTIONS = "distortion_params"
"""Nerfstudio's list of these six; of other lenses it has other numbers."""
_MASK = "mask_path"
_SIZES = ("w", "h", "fl_x", "fl_y", "cx", "cy", "camera_angle_x", "camera_angle_y")
_SHARED = (*_SIZES, "camera_model", "is_fisheye", *_DISTORTIONS, _ALL_DISTORTIONS)
"""Fields that may stand above the frames and then hold for all of them."""
_OTHER_AXES = "from_mitsuba"
"""Instant-NGP's mark of poses whose x points left and z forward."""
_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
ENDINGS = ("", ".png", ".jpg", ".jpeg", ".JPG", ".JPEG", ".PNG")
"""Blender's file names leave out the ending, INRIA's lists too."""
_SPLITS = {"train_filenames": "train", "val_filenames": "test", "test_filenames": "test"}


def transforms_cameras(file: str, document: Mapping[str, Any], frames: list[Any], dataparser: Any) -> list[Camera]:
    """The cameras of a `transforms.json`.

    Args:
        dataparser: content of the `dataparser_transforms.json` beside it, or None.

    Raises:
        InvalidInput: ``input-cameras``.

    Warns:
        InputWarning: lens distortion is ignored, or masks are not read.
    """
    splits = _splits(file, document)
    placed = _Placement.of(file, document, dataparser)
    records = _frames(file, document, frames)
    _warn_of_masks(file, records)
    for record in records:
        if _lens_model(record) not in PINHOLE_MODELS:
            raise _not_drawn(record)
    cameras = [_camera(record, placed, splits) for record in records]
    if any(_distorts(record) for record in records):
        warnings.warn(f"{file}: lens distortion (k1, ...) is ignored", InputWarning, stacklevel=3)
    return cameras


def transforms_distorted(file: str, document: Mapping[str, Any], frames: list[Any], dataparser: Any) -> list[Distorted]:
    """The views of a `transforms.json` with their lenses as they are; none where all lenses are pinholes.

    Arguments and errors are those of :func:`transforms_cameras`.

    Warns:
        InputWarning: masks are not read.
    """
    records = _frames(file, document, frames)
    if not any(_distorts(record) for record in records):
        return []
    _warn_of_masks(file, records)
    splits = _splits(file, document)
    placed = _Placement.of(file, document, dataparser)
    return [_read_distortion(record, _camera(record, placed, splits)) for record in records]


def transforms_points(file: str, document: Mapping[str, Any], dataparser: Any, points: F64) -> F64:
    """(P, 3) float64 points of the file's world where :func:`transforms_cameras` places the cameras.

    Raises:
        InvalidInput: ``input-cameras``.
    """
    placed = _Placement.of(file, document, dataparser)
    moved: F64 = placed.scale * (points @ placed.transform[:3, :3].T + placed.transform[:3, 3])
    return moved


class _Placement:
    """From the file's world to the scene's: a rotation with translation, then a scale."""

    def __init__(self, transform: F64, scale: float):
        self.transform = transform
        self.scale = scale

    @staticmethod
    def of(file: str, document: Mapping[str, Any], dataparser: Any) -> _Placement:
        if dataparser is None:
            return _Placement(np.eye(4), 1.0)
        beside = str(Path(file).parent / DATAPARSER)
        scene = Record.of(beside, "transform", dataparser)
        whole = Record(file, "top level", dict(document))
        applied = whole.affine("applied_transform") if "applied_transform" in document else np.eye(4)
        whole.check_rotation("applied_transform", applied[:3, :3])
        transform = scene.affine("transform")
        scene.check_rotation("transform", transform[:3, :3])
        scale = scene.positive("scale", 1.0) / whole.positive("applied_scale", 1.0)
        return _Placement(transform @ invert(applied), scale)

    def __call__(self, camera_to_world: F64) -> F64:
        placed: F64 = self.transform @ camera_to_world
        placed[:3, 3] *= self.scale
        return placed


def _frames(file: str, document: Mapping[str, Any], frames: list[Any]) -> list[Record]:
    whole = Record(file, "top level", {})
    if document.get(_OTHER_AXES):
        raise whole.fault(_OTHER_AXES, f"poses with Mitsuba's axes are not read; {EXPORT_AGAIN} with OpenGL's")
    shared = {key: document[key] for key in _SHARED if key in document}
    found = []
    for index, frame in enumerate(frames):
        record = Record.of(file, f"frames[{index}]", frame)
        there = {key: value for key, value in (shared | record.values).items() if value is not None}
        found.append(_name_distortions(Record(file, record.place, there)))
    return found


def _name_distortions(record: Record) -> Record:
    """The record with the coefficients of its list of them, if it has one, each under its name."""
    if _ALL_DISTORTIONS not in record.values or _lens_model(record) not in (*PINHOLE_MODELS, _FISHEYE):
        return record
    listed = record.numbers(_ALL_DISTORTIONS, len(_DISTORTIONS)).tolist()
    return replace(record, values=record.values | dict(zip(_DISTORTIONS, listed, strict=True)))


def _warn_of_masks(file: str, records: list[Record]) -> None:
    masked = sum(_MASK in record.values for record in records)
    if masked:
        message = f"{file}: masks ({_MASK}) of {plural(masked, 'photo')} are not read: what they hide is seen"
        warnings.warn(message, InputWarning, stacklevel=4)


def _lens_model(record: Record) -> str:
    return _FISHEYE if record.values.get("is_fisheye") is True else record.text("camera_model").upper()


def _distorts(record: Record) -> bool:
    coefficients = any(record.values.get(key) not in (0, None) for key in _DISTORTIONS)
    return coefficients or _lens_model(record) not in PINHOLE_MODELS


def _not_drawn(record: Record) -> InvalidInput:
    advice = "undistort the photos, and give the resulting cameras"
    return record.fault("camera_model", how_to_draw(_lens_model(record)[:40], advice))


def _read_distortion(record: Record, camera: Camera) -> Distorted:
    """Distortion as OpenCV defines it, whose coefficients the file has; they are radial but for p1 and p2."""
    k1, k2, k3, k4, p1, p2 = (record.number(key, 0.0) for key in _DISTORTIONS)
    pinhole = (camera.fx, camera.fy, camera.cx, camera.cy)
    parameters: tuple[float, ...]
    if _lens_model(record) == _FISHEYE:
        model, parameters = _FISHEYE, (*pinhole, k1, k2, k3, k4)
    elif _lens_model(record) not in PINHOLE_MODELS or k4 != 0:
        raise _not_drawn(record)
    elif k3 == 0:
        model, parameters = "OPENCV", (*pinhole, k1, k2, p1, p2)
    else:
        model, parameters = "FULL_OPENCV", (*pinhole, k1, k2, p1, p2, k3, 0.0, 0.0, 0.0)
    return Distorted(model, parameters, camera.width, camera.height, camera.world_to_camera, camera.name, camera.split)


def _camera(record: Record, placed: _Placement, splits: dict[str, str]) -> Camera:
    width, height = size = _size(record)
    focal_x = _focal(record, "x", width)
    focal_y = _focal(record, "y", height) or focal_x
    if not focal_y:
        raise record.fault("fl_x", "no focal length: neither fl_x nor camera_angle_x is there, in the frame or above")
    centre = record.number("cx", width / 2), record.number("cy", height / 2)
    camera_to_world = record.affine("transform_matrix")
    record.check_rotation("transform_matrix", camera_to_world[:3, :3])
    pose = invert(placed(camera_to_world @ _FLIP))
    name = record.text("file_path")
    focal = focal_x or focal_y, focal_y
    return record.camera("transform_matrix", pose, size, focal, centre, name, splits.get(_plain(name), ""))


def _focal(record: Record, axis: str, pixels: int) -> float:
    """The focal length along an axis, pixels; 0 where none is there."""
    if (key := f"fl_{axis}") in record.values:
        return record.positive(key)
    if (key := f"camera_angle_{axis}") not in record.values:
        return 0.0
    angle = record.positive(key)
    if angle >= math.pi:
        raise record.fault(key, f"{key} is {angle:g} and has to be below pi: it is in radians")
    return focal_of_angle(angle, pixels)


def _size(record: Record) -> tuple[int, int]:
    """Width and height, pixels: of the frame or the file, else of the photo."""
    if "w" in record.values or "h" in record.values:
        return record.pixels("w"), record.pixels("h")
    from PIL import Image, UnidentifiedImageError

    name = record.text("file_path")
    file = None if "\0" in name else picture_file(Path(record.file).parent, name)
    if file is None:
        message = f"neither w and h are there nor the photo {name[:80]!r}: give the sizes, or put the photos beside"
        raise record.fault("w", message)
    try:
        with Image.open(file) as image:
            width, height = image.size
    except (UnidentifiedImageError, Image.DecompressionBombError, SyntaxError, OSError) as error:
        raise record.fault("w", f"w and h are not there, and {file} is no readable picture") from error
    sized = Record(record.file, record.place, {"w": width, "h": height})
    return sized.pixels("w"), sized.pixels("h")


def picture_file(folder: Path, name: str) -> Path | None:
    """The picture of a name, which lists may give without its ending; None where there is none."""
    if not name:
        return None
    # Lists that were made on Windows have its separator.
    candidates = (folder / f"{form}{ending}" for form in (name, name.replace("\\", "/")) for ending in ENDINGS)
    return next((file for file in candidates if file.is_file()), None)


def _splits(file: str, document: Mapping[str, Any]) -> dict[str, str]:
    """Picture name -> split, if the file states it. Pictures held out to validate count as test."""
    splits = {}
    for key, split in _SPLITS.items():
        names = document.get(key, [])
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise Record(file, "top level", {}).fault(key, f"{key} has to be a list of file names")
        splits.update(dict.fromkeys(map(_plain, names), split))
    return splits


def _plain(name: str) -> str:
    """A name as all writers would have it: `./` before it, or the separator of Windows, make no other picture."""
    return str(PurePosixPath(name.replace("\\", "/")))
