"""Photos with their cameras, read and checked: what training learns from (:func:`load_capture`).

All that can be wrong with a capture is found here, before anything slow begins.
"""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike
from pathlib import Path

import numpy as np

from reference_encoder.training.area import area_filtered
from reference_encoder.training.options import HOLD_OUT, LEAST_RESOLUTION
from reference_encoder.training.pictures import bare_photos, black, named, photo_files, wrong_capture
from reference_encoder.training.poses import posed, undistorted
from reference_encoder.training.start import drawn_points
from scarfmt.arrays import F64, U8
from scarfmt.coding.writer import Report, silent
from scarfmt.errors import InputWarning, InvalidInput
from scarfmt.render.camera import Camera
from scarfmt.render.capture import load_cameras, load_distorted, load_points
from scarfmt.render.capture.points import Points
from scarfmt.render.images import read_pixels

FEWEST_PHOTOS = 2


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
        """The photos to learn from; at least one."""
        return tuple(photo for photo in self.photos if photo.camera.split == "train")

    @property
    def test(self) -> tuple[Photo, ...]:
        """The photos held out to measure with; none if the user asked for none."""
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


def load_capture(
    path: str | PathLike[str],
    resolution: int | None = None,
    hold_out: int = HOLD_OUT,
    workspace: str | PathLike[str] | None = None,
    report: Report = silent,
) -> Capture:
    """The capture at `path`, with every photo looked at.

    Args:
        path: what :func:`scarfmt.load_cameras` reads, with the photos beside it, by the names it gives or in `images/`;
            or a folder of photos alone, JPEG or PNG, whose poses are found (extra ``poses``).
        resolution: longest side of the photos, pixels: larger ones are filtered down to it; None for as they are.
        hold_out: every so manieth photo is for tests, unless the file says which are; 0 for none at all.
        workspace: folder for photos made anew because their lens distorts or their poses were found; it has to stay as
            long as the capture is used, and is read again instead of working again.
        report: told (stage, part done).

    Raises:
        InvalidInput: ``input-cameras``, ``input-corrupt``: poses or points cannot be read; ``input-image``: a photo
            cannot; ``input-capture``: too few photos, one is missing or has another size than its camera says, all are
            black, no pose is found, or no photo is left to learn from or to test with; ``input-options``: also where
            a workspace is needed; ``input-dependency``.
        OSError: a file cannot be read.

    Warns:
        InputWarning: single photos are left out, black or without a pose, or there are no points.
    """
    _check(resolution, hold_out)
    report("read the photos", 0.0)
    read = _posed if bare_photos(Path(path)) else _listed
    photos, points = read(Path(path), None if workspace is None else Path(workspace), report)
    photos = _split(path, sorted(photos, key=lambda photo: photo.camera.name), hold_out)
    sized = tuple(_sized(photo, resolution) for photo in photos)
    if points is None or not len(points.positions):
        message = f"{path}: has no points to start from: some are drawn at random where the cameras look"
        warnings.warn(message, InputWarning, stacklevel=2)
        points = drawn_points([photo.camera for photo in sized])
    return Capture(sized, points.positions, points.colours)


def pixels(photo: Photo) -> U8:
    """(height, width, 3) uint8 of a photo, filtered down by areas where its camera is smaller.

    Raises:
        InvalidInput: ``input-image``.
        OSError: it cannot be read.
    """
    return area_filtered(read_pixels(photo.path), photo.camera.width, photo.camera.height)


def _check(resolution: int | None, hold_out: int) -> None:
    if resolution is not None and resolution < LEAST_RESOLUTION:
        message = f"{resolution} pixels show too little: {LEAST_RESOLUTION} are least"
        raise InvalidInput("input-options", message, field="resolution")
    if hold_out < 0 or hold_out == 1:
        message = f"every {hold_out}th photo cannot be held out: 0 (none) or 2 and more are possible"
        raise InvalidInput("input-options", message, field="hold_out")


def _check_number(path: str | PathLike[str], count: int) -> None:
    if count < FEWEST_PHOTOS:
        raise wrong_capture(path, f"{count} photo; at least {FEWEST_PHOTOS} are needed, and tens to hundreds are usual")


def _listed(path: Path, workspace: Path | None, report: Report) -> tuple[list[Photo], Points | None]:
    """The photos of a list of cameras, and its points."""
    distorted = load_distorted(path)
    cameras = [] if distorted else load_cameras(path)
    views = distorted or cameras
    _check_number(path, len(views))
    files = photo_files(path, views)
    points = load_points(path)
    lit = _lit(path, [view.name for view in views], files)
    shown = [files[index] for index in lit]
    if not distorted:
        return [Photo(cameras[index], file) for index, file in zip(lit, shown, strict=True)], points
    made = undistorted(path, [distorted[index] for index in lit], shown, workspace, report)
    return [Photo(camera, file) for camera, file in made], points


def _posed(path: Path, workspace: Path | None, report: Report) -> tuple[list[Photo], Points]:
    """The photos of a folder without a list, as far as their poses are found."""
    files = bare_photos(path)
    _check_number(path, len(files))
    lit = [files[index] for index in _lit(path, [file.name for file in files], files)]
    made, points = posed(path, lit, workspace, report)
    gone = sorted({file.name for file in lit} - {camera.name for camera, _ in made})
    if gone:
        warnings.warn(f"{path}: left out {named(gone)}: no pose was found", InputWarning, stacklevel=3)
    return [Photo(camera, file) for camera, file in made], points


def _lit(path: Path, names: Sequence[str], files: Sequence[Path]) -> list[int]:
    """Numbers of the photos that show something."""
    dark = black(files)
    lit = [index for index, nothing in enumerate(dark) if not nothing]
    if len(lit) < len(files) and len(lit) < FEWEST_PHOTOS:
        message = f"{len(files) - len(lit)} of {len(files)} photos are black all over: too few show anything"
        raise wrong_capture(path, message)
    if len(lit) < len(files):
        gone = [name for name, nothing in zip(names, dark, strict=True) if nothing]
        warnings.warn(f"{path}: left out {named(gone)}: black all over", InputWarning, stacklevel=4)
    return lit


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
