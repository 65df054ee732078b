"""Photos with their cameras, read and checked: what training learns from (:func:`load_capture`).

All that can be wrong with a capture is found here, before anything slow begins.
"""

from __future__ import annotations

import hashlib
import warnings
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike
from pathlib import Path

import numpy as np

from reference_encoder.training.area import area_filtered
from reference_encoder.training.start import drawn_points
from scarfmt.arrays import F64, U8
from scarfmt.errors import InputWarning, InvalidInput
from scarfmt.render.camera import Camera
from scarfmt.render.capture import listings, load_cameras, load_points
from scarfmt.render.images import opened_image, read_pixels

FEWEST_PHOTOS = 2
HOLD_OUT = 8
"""The papers' convention: of the photos sorted by name, the first and every 8th after it."""
_ENDINGS = ("", ".png", ".jpg", ".jpeg", ".JPG", ".JPEG", ".PNG")
"""Blender's file names leave out the ending, INRIA's lists too."""
_BLACK = 8
"""A photo whose brightest value is not above is black: what a lens cap leaves after JPEG."""
_SHOWN_NAMES = 3


@dataclass(frozen=True)
class Photo:
    """A photo and where it was taken.

    Attributes:
        camera: with the size of the pixels that :func:`pixels` gives; `split` is ``"train"`` or ``"test"``.
        path: of the picture.
    """

    camera: Camera
    path: Path


@dataclass(frozen=True)
class Capture:
    """Photos of one scene.

    Attributes:
        photos: sorted by name, at least two.
        points: (P, 3) float64 on surfaces, world units; where training starts.
        colours: (P, 3) uint8 of the points.
    """

    photos: tuple[Photo, ...]
    points: F64
    colours: U8

    @property
    def train(self) -> tuple[Photo, ...]:
        """Those to learn from; at least one."""
        return tuple(photo for photo in self.photos if photo.camera.split == "train")

    @property
    def test(self) -> tuple[Photo, ...]:
        """Those held out, to measure with; none where that was asked for."""
        return tuple(photo for photo in self.photos if photo.camera.split == "test")

    @cached_property
    def digest(self) -> str:
        """A hash of names, cameras, splits, file sizes and points: two captures that differ in any differ in it."""
        found = hashlib.sha256()
        for photo in self.photos:
            camera = photo.camera
            lens = (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy)
            found.update(repr((camera.name, camera.split, lens, photo.path.stat().st_size)).encode())
            found.update(np.ascontiguousarray(camera.world_to_camera).tobytes())
        found.update(np.ascontiguousarray(self.points).tobytes() + np.ascontiguousarray(self.colours).tobytes())
        return found.hexdigest()


def load_capture(path: str | PathLike[str], resolution: int | None = None, hold_out: int = HOLD_OUT) -> Capture:
    """The capture at `path`, with every photo looked at.

    Args:
        path: what :func:`scarfmt.load_cameras` reads, with the photos beside it, by the names it gives or in `images/`.
        resolution: longest side of the photos, pixels: larger ones are filtered down to it; None for as they are.
        hold_out: every so manieth photo is for tests, unless the file says which are; 0 for none at all.

    Raises:
        InvalidInput: ``input-cameras``, ``input-corrupt``: poses or points cannot be read; ``input-image``: a photo
            cannot; ``input-capture``: too few photos, one is missing or has another size than its camera says, all are
            black, or no photo is left to learn from or to test with; ``input-options``.
        OSError: a file cannot be read.

    Warns:
        InputWarning: lens distortion is ignored, single photos are black and left out, or there are no points.
    """
    _check(resolution, hold_out)
    found = sorted(_photos(Path(path)), key=lambda photo: photo.camera.name)
    _check_number(path, len(found))
    lit = _without_black(path, found)
    photos = tuple(_sized(photo, resolution) for photo in _split(path, lit, hold_out))
    points = load_points(path)
    if points is None or not len(points.positions):
        message = f"{path}: has no points to start from: some are drawn at random where the cameras look"
        warnings.warn(message, InputWarning, stacklevel=2)
        points = drawn_points([photo.camera for photo in photos])
    return Capture(photos, points.positions, points.colours)


def pixels(photo: Photo) -> U8:
    """(height, width, 3) uint8 of a photo, filtered down by areas where its camera is smaller.

    Raises:
        InvalidInput: ``input-image``.
        OSError: it cannot be read.
    """
    return area_filtered(read_pixels(photo.path), photo.camera.width, photo.camera.height)


def wrong_capture(path: str | PathLike[str], message: str) -> InvalidInput:
    """The error for a capture that cannot be trained from: ``input-capture``."""
    return InvalidInput("input-capture", f"{path}: {message}")


def _check(resolution: int | None, hold_out: int) -> None:
    if resolution is not None and resolution < 16:
        message = f"{resolution} pixels show too little: 16 are least"
        raise InvalidInput("input-options", message, field="resolution")
    if hold_out < 0 or hold_out == 1:
        message = f"every {hold_out}th photo cannot be held out: 0 (none) or 2 and more are possible"
        raise InvalidInput("input-options", message, field="hold_out")


def _check_number(path: str | PathLike[str], count: int) -> None:
    if count < FEWEST_PHOTOS:
        raise wrong_capture(path, f"{count} photo; at least {FEWEST_PHOTOS} are needed, and tens to hundreds are usual")


def _photos(path: Path) -> list[Photo]:
    """Every camera with its photo, which is there and has the size the camera says."""
    cameras = load_cameras(path)
    repeated = [name for name, count in Counter(camera.name for camera in cameras).items() if count > 1]
    if repeated:
        what = "has no name" if not repeated[0] else f"is listed twice: {repeated[0]}"
        raise wrong_capture(path, f"a photo {what}; each camera needs the name of its own photo")
    folders = _folders(path)
    found = {camera.name: _picture(folders, camera.name) for camera in cameras}
    missing = [name for name, file in found.items() if file is None]
    if missing:
        where = " nor ".join(map(str, folders[:2]))
        message = f"{len(missing)} of {len(cameras)} photos are missing, {_named(missing)}: neither in {where}"
        raise wrong_capture(path, message)
    photos = [Photo(camera, file) for camera in cameras if (file := found[camera.name]) is not None]
    for photo in photos:
        _check_size(path, photo)
    return photos


def _folders(path: Path) -> list[Path]:
    """Where photos may lie, most likely first. COLMAP's models lie below the folder that holds `images/`."""
    base = path if path.is_dir() else path.parent
    above = [base, *base.parents[:2]] if listings(path)[0].suffix != ".json" else [base]
    return [folder for parent in above for folder in (parent / "images", parent)]


def _picture(folders: Sequence[Path], name: str) -> Path | None:
    if "\0" in name:
        return None
    candidates = (folder / f"{name}{ending}" for folder in folders for ending in _ENDINGS)
    return next((file for file in candidates if file.is_file()), None)


def _named(names: Sequence[str]) -> str:
    more = len(names) - _SHOWN_NAMES
    return ", ".join(names[:_SHOWN_NAMES]) + (f" and {more} more" if more > 0 else "")


def _check_size(path: str | PathLike[str], photo: Photo) -> None:
    camera = photo.camera
    with opened_image(photo.path) as image:
        width, height = image.size
    if (width, height) != (camera.width, camera.height):
        message = (
            f"{photo.path.name} has {width}x{height} pixels, but its camera {camera.width}x{camera.height}; give the"
            " photos the poses were made from, or scale the cameras too"
        )
        raise wrong_capture(path, message)


def _without_black(path: str | PathLike[str], photos: Sequence[Photo]) -> list[Photo]:
    """Those that show something. Every photo is read to its end for it, which finds what is cut short."""
    with ThreadPoolExecutor() as pool:
        black = list(pool.map(lambda photo: bool(read_pixels(photo.path).max() <= _BLACK), photos))
    names = [photo.camera.name for photo, dark in zip(photos, black, strict=True) if dark]
    left = [photo for photo, dark in zip(photos, black, strict=True) if not dark]
    if names and len(left) < FEWEST_PHOTOS:
        raise wrong_capture(path, f"{len(names)} of {len(photos)} photos are black all over: too few show anything")
    if names:
        warnings.warn(f"{path}: left out {_named(names)}: black all over", InputWarning, stacklevel=3)
    return left


def _split(path: str | PathLike[str], photos: Sequence[Photo], hold_out: int) -> list[Photo]:
    """Every photo marked: as the file says, else every `hold_out`-th for tests."""
    own = hold_out > 0 and any(photo.camera.split for photo in photos)
    marked = []
    for index, photo in enumerate(photos):
        chosen = photo.camera.split == "test" if own else hold_out > 0 and index % hold_out == 0
        marked.append(replace(photo, camera=replace(photo.camera, split="test" if chosen else "train")))
    splits = {photo.camera.split for photo in marked}
    if "train" not in splits:
        raise wrong_capture(path, f"no photo to learn from: all {len(photos)} are marked for tests")
    if own and "test" not in splits:
        message = f"no photo to test with: all {len(photos)} are marked for training; mark some, or hold out none"
        raise wrong_capture(path, message)
    return marked


def _sized(photo: Photo, resolution: int | None) -> Photo:
    longest = max(photo.camera.width, photo.camera.height)
    if resolution is None or longest <= resolution:
        return photo
    return replace(photo, camera=photo.camera.scaled(resolution / longest))
