"""Frames of a video to learn from: of each stretch of time the sharpest, as photos in a folder of the run.

OpenCV (extra ``video``) decodes. It turns frames as the video says, and makes 8-bit RGB of what has more bits. Since
4.13 it turns HDR into SDR, and cuts what is brighter than paper white.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Iterator
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from reference_encoder.training.photo_files import wrong_capture
from reference_encoder.training.poses import describe_files, make_once, workplace
from scarfmt.arrays import F32, U8
from scarfmt.coding.writer import Report
from scarfmt.errors import LossWarning

FRAMES = "frames"
_SUFFIXES = (".mp4", ".mov", ".m4v", ".mkv", ".webm", ".avi", ".3gp", ".mpg", ".mts")
_COUNT, _FEWEST = 150, 20
"""Frames that are taken of a video, and that it has to have."""
_LEAST_WINDOW, _USUAL_WINDOW = 0.1, 0.5
"""Seconds of which one frame is taken: at least, and where the video does not say how long it is."""
_STILL = 2.0
"""Mean difference of two small grey frames, of 255, up to which the camera stands: about a 300th of a frame's width.
Six seconds of it among twelve made finding poses take 2.6 times as long (2026-11-29)."""
_WHOLE = 0.9
"""Part of the time it states that a video lasts at least, or it is cut short."""
_QUALITY = 95

Frame = tuple[float, U8]
"""Seconds from the start of a video, and (height, width, 3) pixels."""


def is_video(path: Path) -> bool:
    """Whether there is a file, and its name is that of a video."""
    return path.suffix.lower() in _SUFFIXES and path.is_file()


def pick_frames(path: Path, workspace: Path | None, report: Report) -> Path:
    """A folder in the workspace with about 150 frames of a video, JPEGs named by their milliseconds.

    Args:
        path: of the video.
        workspace: folder for what is made, which is made once.
        report: called with (stage, part done).

    Raises:
        InvalidInput: ``input-dependency``; ``input-options``: there is no workspace; ``input-capture``: no video that
            can be read, or too few frames that differ.
        OSError: the video cannot be read, or the disk is full.

    Warns:
        LossWarning: the video is cut short, or may be HDR.
    """
    place = workplace(path, "to pick frames of it", workspace, "cv2", "video")
    workplace(path, "to find poses of its frames", workspace)

    def make(folder: Path) -> None:
        for second, picture in moving(_sharp_frames(path, report)):
            file = folder / f"{round(1000 * second):08}.jpg"
            Image.fromarray(picture).save(file, quality=_QUALITY, subsampling=0)
        count = len(list(folder.iterdir()))
        if count < _FEWEST:
            message = f"has {count} frames that differ, and {_FEWEST} are needed: film the scene from all sides"
            raise wrong_capture(path, message)

    return make_once(place, FRAMES, describe_files([path], "frames"), make)


def opencv() -> Any:
    """OpenCV, without what it and FFmpeg print: errors say it."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    import cv2

    return cv2


def _sharp_frames(path: Path, report: Report) -> Iterator[Frame]:
    """The sharpest frame of each stretch of time."""
    cv2 = opencv()
    video = cv2.VideoCapture(str(path.absolute()), cv2.CAP_FFMPEG)
    rate, count = video.get(cv2.CAP_PROP_FPS), video.get(cv2.CAP_PROP_FRAME_COUNT)
    length = count / rate if rate > 0 and count > 0 else 0.0
    _warn_of_bits(path, int(video.get(cv2.CAP_PROP_CODEC_PIXEL_FORMAT)))
    last = -1.0

    def frames() -> Iterator[Frame]:
        nonlocal last
        while (read := video.read())[0]:
            last = video.get(cv2.CAP_PROP_POS_MSEC) / 1000
            report(f"pick frames: {last:.0f} of {length:.0f} s", 0.0)
            yield last, np.ascontiguousarray(read[1][..., ::-1])

    window = max(length / _COUNT, _LEAST_WINDOW) if length else _USUAL_WINDOW
    yield from sharpest(frames(), window)
    video.release()
    if last < 0:
        raise wrong_capture(path, "has no frame that can be read; copy it again, or save it as MP4 with H.264")
    if last < _WHOLE * length - window:
        message = f"{path}: ends after {last:.0f} s of the {length:.0f} s it states: it is damaged or cut short"
        warnings.warn(message, LossWarning, stacklevel=2)


def _warn_of_bits(path: Path, pixel_format: int) -> None:
    """Warn of a video of more than 8 bits: OpenCV does not tell whether it is HDR.

    Args:
        pixel_format: FourCC; FFmpeg's of planes of more bits end with their number, others with a letter or a digit.
    """
    if 8 < (bits := pixel_format >> 24) <= 16:
        message = f"{path}: has {bits} bits a colour: if it is HDR, its brightest lights are cut; export it as SDR"
        warnings.warn(message, LossWarning, stacklevel=2)


def sharpest(frames: Iterable[Frame], window: float) -> Iterator[Frame]:
    """The sharpest frame of each `window` seconds; one frame is kept at a time."""
    for _, together in groupby(frames, key=lambda frame: frame[0] // window):
        yield max(together, key=lambda frame: sharpness(frame[1]))


def sharpness(picture: U8) -> float:
    """Variance of the Laplacian of a grey picture half as wide and high, at least 6 x 6 pixels."""
    grey = _grey(Image.fromarray(picture).reduce(2))
    middle, rows, columns = grey[1:-1, 1:-1], grey[:-2, 1:-1] + grey[2:, 1:-1], grey[1:-1, :-2] + grey[1:-1, 2:]
    return float((4 * middle - rows - columns).var())


def moving(frames: Iterable[Frame]) -> Iterator[Frame]:
    """Frames without those that hardly differ from the one before them that is kept."""
    before = None
    for second, picture in frames:
        small = _grey(Image.fromarray(picture).resize((64, 64), Image.Resampling.BOX))
        if before is None or np.abs(small - before).mean() > _STILL:
            before = small
            yield second, picture


def _grey(image: Image.Image) -> F32:
    return np.asarray(image.convert("L"), np.float32)
