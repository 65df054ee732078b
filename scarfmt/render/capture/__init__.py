"""A photo capture, from files that programs write: its cameras (:func:`load_cameras`), points (:func:`load_points`).

The content decides the format.

Only NumPy, json and, where a photo has to say its size, Pillow are imported: a wrong file is told before anything
slow begins.
"""

from __future__ import annotations

import json
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

from scarfmt.arrays import F64
from scarfmt.render.camera import Camera
from scarfmt.render.capture.colmap import colmap_cameras, colmap_distorted, model_files, warn_of_parts
from scarfmt.render.capture.foreign import describe_document, describe_file
from scarfmt.render.capture.points import colmap_points, ply_points
from scarfmt.render.capture.record import (
    MAX_CAMERAS,
    MAX_LISTING_BYTES,
    Distorted,
    Record,
    inria_camera,
    own_camera,
    wrong,
)
from scarfmt.render.capture.transforms import DATAPARSER, transforms_cameras, transforms_distorted, transforms_points

__all__ = ["held_out", "load_cameras", "load_distorted", "load_points"]

_MODEL_FILES = {f"{kind}{ending}" for kind in ("cameras", "images") for ending in (".bin", ".txt")}
_KNOWN = (
    'a JSON object with "images" (scarfmt) or "frames" (transforms.json), a JSON array (INRIA\'s cameras.json), or a'
    " folder of COLMAP with cameras and images, .bin or .txt"
)
_BLENDER = {"transforms_train.json": "train", "transforms_test.json": "test", "transforms_val.json": "test"}
"""Files of NeRF's synthetic scenes, one for each split; that to validate is read where another is missing."""
_DEPTHS = ("*", "*/*", "*/*/*")
"""Where a model of COLMAP may lie that a folder is not searched for."""
_POINTS = ("points3d.ply", "points3D.ply", "input.ply")
"""Point files beside a list that names none: those of this project, of COLMAP, and the one INRIA's trainer copies."""


def load_cameras(path: str | PathLike[str]) -> list[Camera]:
    """Cameras of a photo capture.

    Args:
        path: a JSON file of this project, INRIA's `cameras.json`, Nerfstudio's or Blender's `transforms.json`; or a
            folder with one of these, with Blender's `transforms_train.json` and `transforms_test.json`, or with a
            sparse model of COLMAP, also in its `sparse`, `sparse/0` or `colmap/sparse/0`.

    Returns:
        At least one camera, in the order of the file (COLMAP: of the photos' names); marked train and test where the
        file does.

    Raises:
        InvalidInput: ``input-cameras``: it is not one of these, or a value in it is out of range.
        OSError: it cannot be read.

    Warns:
        InputWarning: lens distortion is ignored, masks are not read, a list has another length than it says, or COLMAP
            wrote several models.
    """
    files = listings(Path(path))
    found = [
        camera if len(files) == 1 else replace(camera, split=_BLENDER[file.name])
        for file in files
        for camera in _cameras(file)
    ]
    if not found:
        raise wrong(str(path), "lists no cameras; export them again")
    if files[0].name in _MODEL_FILES and files[0].parent.name == "0" and files[0].parent != Path(path):
        warn_of_parts(files[0].parent)
    return found


def held_out(cameras: list[Camera]) -> list[Camera]:
    """The cameras marked ``"test"``; all cameras if none is marked."""
    return [camera for camera in cameras if camera.split == "test"] or cameras


def load_distorted(path: str | PathLike[str]) -> list[Distorted]:
    """The views of a capture with their lenses as they are; none where all are pinholes.

    Args:
        path: as for :func:`load_cameras`.

    Raises:
        InvalidInput: ``input-cameras``.
        OSError: it cannot be read.
    """
    return [view for file in listings(Path(path)) for view in _find_distorted(file)]


def load_points(path: str | PathLike[str]) -> F64 | None:
    """(P, 3) float64 points of a photo capture, in the frame of its cameras; None where it has none.

    Args:
        path: as for :func:`load_cameras`. Points are COLMAP's `points3D`, the `ply_file_path` of a `transforms.json`,
            or a `points3d.ply` beside a list of cameras.

    Raises:
        InvalidInput: ``input-cameras``, ``input-corrupt``, ``input-limit``: they cannot be read.
        OSError: a file cannot be read.
    """
    file = listings(Path(path))[0]
    if file.name in _MODEL_FILES:
        return colmap_points(file.parent)
    match _json(file):
        case {"frames": list(), "ply_file_path": str(name)} as document if name:
            return transforms_points(str(file), document, _dataparser(file), ply_points(file.parent / name))
    beside = next((file.parent / name for name in _POINTS if (file.parent / name).is_file()), None)
    return None if beside is None else ply_points(beside)


def listings(path: Path) -> list[Path]:
    """The files that list the cameras of a capture: one, or Blender's two; of a COLMAP model its `images`.

    A list tells more than a sparse model: which cameras are for tests. `transforms.json` has a frame of its own.

    Raises:
        InvalidInput: ``input-cameras``: the folder holds none.
    """
    if not path.is_dir():
        return [path]
    if (path / "cameras.json").is_file():
        return [path / "cameras.json"]
    if (model := model_files(path)) is not None:
        return [model[1]]
    if (path / "transforms.json").is_file():
        return [path / "transforms.json"]
    if blender := [path / name for name in _BLENDER if (path / name).is_file()]:
        return blender[:2]
    below = (file.parent for depth in _DEPTHS for file in path.glob(f"{depth}/images.*"))
    inner = next(filter(model_files, below), None)
    advice = f"known are {_KNOWN}" if inner is None else f"give {inner}"
    raise wrong(str(path), f"no cameras in this folder; {advice}")


def _cameras(path: Path) -> list[Camera]:
    if path.name in _MODEL_FILES:
        model = model_files(path.parent)
        if model is None:
            raise wrong(str(path), "COLMAP's cameras and images are needed both, side by side, .bin or .txt")
        return colmap_cameras(*model)
    document = _json(path)
    if whose := describe_document(document):
        raise wrong(str(path), f"is {whose}")
    match document:
        case {"images": list(entries)}:
            return [own_camera(record) for record in _records(path, "images", entries)]
        case {"frames": list(frames)}:
            _check_number(path, frames)
            return transforms_cameras(str(path), document, frames, _dataparser(path))
        case list(entries):
            return [inria_camera(record) for record in _records(path, "", entries)]
    raise wrong(str(path), f"is no list of cameras; known are {_KNOWN}")


def _find_distorted(path: Path) -> list[Distorted]:
    if path.name in _MODEL_FILES:
        model = model_files(path.parent)
        return [] if model is None else colmap_distorted(*model)
    match _json(path):
        case {"frames": list(frames)} as document:
            _check_number(path, frames)
            return transforms_distorted(str(path), document, frames, _dataparser(path))
    return []


def _dataparser(path: Path) -> Any:
    beside = path.parent / DATAPARSER
    return _json(beside) if beside.is_file() else None


def _records(path: Path, key: str, entries: list[Any]) -> list[Record]:
    _check_number(path, entries)
    return [Record.of(str(path), f"{key}[{index}]", entry) for index, entry in enumerate(entries)]


def _check_number(path: Path, entries: list[Any]) -> None:
    if len(entries) > MAX_CAMERAS:
        raise wrong(str(path), f"lists {len(entries)} cameras; at most {MAX_CAMERAS} are read")


def _json(path: Path) -> Any:
    with path.open("rb") as stream:
        data = stream.read(MAX_LISTING_BYTES + 1)
    if len(data) > MAX_LISTING_BYTES:
        raise wrong(str(path), f"has over {MAX_LISTING_BYTES >> 20} MiB: a list of cameras is far smaller")
    try:
        return json.loads(data.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        whose = describe_file(path) or f"not JSON ({str(error)[:100]}); known are {_KNOWN}"
        raise wrong(str(path), f"is {whose}") from error
