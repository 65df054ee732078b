"""Cameras of a photo capture, from the files that programs write: :func:`load_cameras`. The content decides the format.

Only NumPy and json are imported: a wrong file is told before anything slow begins.
"""

from __future__ import annotations

import json
from os import PathLike
from pathlib import Path
from typing import Any

from scarfmt.render.camera import Camera
from scarfmt.render.capture.colmap import colmap_cameras, model_files
from scarfmt.render.capture.listing import inria_camera, own_camera
from scarfmt.render.capture.record import MAX_CAMERAS, MAX_LISTING_BYTES, Record, wrong
from scarfmt.render.capture.transforms import DATAPARSER, transforms_cameras

__all__ = ["held_out", "load_cameras"]

_MODEL_FILES = {f"{kind}{ending}" for kind in ("cameras", "images") for ending in (".bin", ".txt")}
_KNOWN = (
    'a JSON object with "images" (scarfmt) or "frames" (transforms.json), a JSON array (INRIA\'s cameras.json), or a'
    " folder of COLMAP with cameras and images, .bin or .txt"
)


def load_cameras(path: str | PathLike[str]) -> list[Camera]:
    """Cameras of a photo capture.

    Args:
        path: a JSON file of this project, INRIA's `cameras.json`, Nerfstudio's or Blender's `transforms.json`; or a
            folder with one of these, or with a sparse model of COLMAP, also in its `sparse` or `sparse/0`.

    Returns:
        At least one camera, in the order of the file (COLMAP: of the photos' names); marked train and test where the
        file does.

    Raises:
        InvalidInput: ``input-cameras``: it is not one of these, or a value in it is out of range.
        OSError: it cannot be read.

    Warns:
        InputWarning: lens distortion is ignored, or a size had to be assumed.
    """
    found = _in_folder(Path(path)) if Path(path).is_dir() else _in_file(Path(path))
    if not found:
        raise wrong(str(path), "lists no cameras; export them again")
    return found


def held_out(cameras: list[Camera]) -> list[Camera]:
    """Those marked ``"test"``; all where none is."""
    return [camera for camera in cameras if camera.split == "test"] or cameras


def _in_folder(folder: Path) -> list[Camera]:
    """A list tells more than a sparse model: which cameras are for tests. `transforms.json` has a frame of its own."""
    model = model_files(folder)
    if (folder / "cameras.json").is_file():
        return _in_file(folder / "cameras.json")
    if model is not None:
        return colmap_cameras(*model)
    if (folder / "transforms.json").is_file():
        return _in_file(folder / "transforms.json")
    raise wrong(str(folder), f"no cameras in this folder; known are {_KNOWN}")


def _in_file(path: Path) -> list[Camera]:
    if path.name in _MODEL_FILES:
        model = model_files(path.parent)
        if model is None:
            raise wrong(str(path), "COLMAP's cameras and images are needed both, side by side, .bin or .txt")
        return colmap_cameras(*model)
    match _json(path):
        case {"images": list(entries)}:
            return [own_camera(record) for record in _records(path, "images", entries)]
        case {"frames": list(frames)} as document:
            _check_number(path, frames)
            beside = path.parent / DATAPARSER
            return transforms_cameras(str(path), document, frames, _json(beside) if beside.is_file() else None)
        case list(entries):
            return [inria_camera(record) for record in _records(path, "", entries)]
    raise wrong(str(path), f"is no list of cameras; known are {_KNOWN}")


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
        raise wrong(str(path), f"is not JSON ({str(error)[:100]}); known are {_KNOWN}") from error
