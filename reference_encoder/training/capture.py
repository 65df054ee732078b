"""Photos with their cameras, read and checked: what training learns from (:func:`load_capture`).

All that can be wrong with a capture is found here, before anything slow begins. Where a capture has no points to start
from, :func:`draw_points` draws some at random where its cameras look.
"""

from __future__ import annotations

import hashlib
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike
from pathlib import Path

import numpy as np

from reference_encoder.training.options import HOLD_OUT, LEAST_RESOLUTION
from reference_encoder.training.photo_files import (
    bare_photos,
    black,
    filter_areas,
    list_names,
    photo_files,
    warn_of_unread,
    wrong_capture,
)
from reference_encoder.training.poses import pose_photos, undistort_photos
from reference_encoder.training.video import is_video, pick_frames
from scarfmt.arrays import F64, U8
from scarfmt.coding.writer import Report, silent
from scarfmt.errors import InputWarning, InvalidInput
from scarfmt.render.camera import Camera, in_view
from scarfmt.render.capture import load_cameras, load_distorted, load_points
from scarfmt.render.images import read_pixels

DRAWN = 20_000
_CANDIDATES = 8 * DRAWN
_SEEN_BY = 1 / 3
"""Least share of the cameras that must see a point of the start: the photos do not show what fewer cameras see."""
_RIDGE = 1e-3
"""Share of the number of cameras that keeps the focus near the eyes if all of them look the same way."""


def draw_points(cameras: Sequence[Camera]) -> F64:
    """Up to 20,000 points, (P, 3), uniform in the part of a ball that a third of the cameras have in their pictures.

    The ball is round the place nearest to all optical axes, and reaches as far as the cameras are from it.

    Args:
        cameras: at least one. The same cameras give the same points.
    """
    eyes = np.array([camera.centre for camera in cameras])
    forward = np.array([camera.world_to_camera[2, :3] for camera in cameras])
    focus = _focus(eyes, forward)
    radius = float(np.median(np.linalg.norm(eyes - focus, axis=1))) or 1.0
    random = np.random.default_rng(0)
    directions = random.normal(size=(_CANDIDATES, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    candidates = focus + radius * np.cbrt(random.random((_CANDIDATES, 1))) * directions
    seen = np.mean([in_view(candidates, camera) for camera in cameras], axis=0)
    enough = seen >= min(_SEEN_BY, float(seen.max()))
    return np.asarray(candidates[enough][:DRAWN])


def _focus(eyes: F64, forward: F64) -> F64:
    """(3,) float64: the place with the least sum of squared distances to all optical axes.

    Where the axes are about parallel it is in front of the cameras, as far as they are spread.
    """
    across = np.eye(3) - forward[:, :, None] * forward[:, None, :]
    spread = float(np.linalg.norm(eyes - eyes.mean(axis=0), axis=1).max()) or 1.0
    guess = (eyes + spread * forward).mean(axis=0)
    ridge = _RIDGE * len(eyes) * np.eye(3)
    wanted = (across @ eyes[:, :, None])[..., 0].sum(axis=0) + ridge @ guess
    focus: F64 = np.linalg.solve(across.sum(axis=0) + ridge, wanted)
    return focus


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
        seconds: that reading took, with the search for poses.
    """

    photos: tuple[Photo, ...]
    points: F64
    seconds: float = 0.0

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
        total = hashlib.sha256()
        for photo in self.photos:
            camera = photo.camera
            lens = (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy)
            total.update(repr((camera.name, camera.split, lens, photo.path.stat().st_size)).encode())
            total.update(np.ascontiguousarray(camera.world_to_camera).tobytes())
        total.update(np.ascontiguousarray(self.points).tobytes())
        return total.hexdigest()


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
            or a folder of photos alone, whose poses are found (extra ``poses``); or a video, of which about 150 frames
            are such photos (extra ``video``).
        resolution: longest side of the photos, pixels: larger ones are filtered down to it; None for as they are.
        hold_out: every so manieth photo is for tests, unless the file says which are; 0 for none at all.
        workspace: folder for frames of a video, and photos made anew because their lens distorts or their poses were
            found; it has to stay as long as the capture is used, and is read again instead of working again.
        report: called with (stage, part done).

    Raises:
        InvalidInput: ``input-cameras``, ``input-corrupt``: poses or points cannot be read; ``input-image``: a photo
            cannot; ``input-capture``: too few photos, one is missing or has another size than its camera says, all are
            black, no pose is found, or no photo is left to learn from or to test with; ``input-options``: also where
            a workspace is needed; ``input-dependency``.
        OSError: a file cannot be read.

    Warns:
        InputWarning: single photos are left out, black or without a pose, or there are no points.
    """
    started = time.monotonic()
    _check(resolution, hold_out)
    path, place = Path(path), None if workspace is None else Path(workspace)
    path = pick_frames(path, place, report) if is_video(path) else path
    report("read the photos", 0.0)
    read = _find_posed if bare_photos(path) else _load_list
    photos, points = read(path, place, report)
    photos = _split(path, sorted(photos, key=lambda photo: photo.camera.name), hold_out)
    sized = tuple(_resize(photo, resolution) for photo in photos)
    if points is None or not len(points):
        message = f"{path}: has no points to start from: some are drawn at random where the cameras look"
        warnings.warn(message, InputWarning, stacklevel=2)
        points = draw_points([photo.camera for photo in sized])
    return Capture(sized, points, time.monotonic() - started)


def pixels(photo: Photo) -> U8:
    """(height, width, 3) uint8 of a photo, filtered down by areas where its camera is smaller.

    Raises:
        InvalidInput: ``input-image``.
        OSError: it cannot be read.
    """
    return filter_areas(read_pixels(photo.path), photo.camera.width, photo.camera.height)


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


def _load_list(path: Path, workspace: Path | None, report: Report) -> tuple[list[Photo], F64 | None]:
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
    made = undistort_photos(path, [distorted[index] for index in lit], shown, workspace, report)
    return [Photo(camera, file) for camera, file in made], points


def _find_posed(path: Path, workspace: Path | None, report: Report) -> tuple[list[Photo], F64]:
    """The photos of a folder without a list, as far as their poses are found."""
    files = bare_photos(path)
    warn_of_unread(path)
    _check_number(path, len(files))
    lit = [files[index] for index in _lit(path, [file.name for file in files], files)]
    made, points = pose_photos(path, lit, workspace, report)
    gone = sorted({file.name for file in lit} - {camera.name for camera, _ in made})
    if gone:
        warnings.warn(f"{path}: left out {list_names(gone)}: no pose was found", InputWarning, stacklevel=3)
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
        warnings.warn(f"{path}: left out {list_names(gone)}: black all over", InputWarning, stacklevel=4)
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


def _resize(photo: Photo, resolution: int | None) -> Photo:
    longest = max(photo.camera.width, photo.camera.height)
    if resolution is None or longest <= resolution:
        return photo
    return replace(photo, camera=photo.camera.scale(resolution / longest))
