"""How close the pictures of one scene are to those of another, or to photos."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from scarfmt.arrays import Floats
from scarfmt.errors import InvalidInput
from scarfmt.render.camera import Camera
from scarfmt.render.capture import load_cameras
from scarfmt.render.images import read_image
from scarfmt.render.metrics import psnr, ssim
from scarfmt.render.projection import Drawable
from scarfmt.render.rasterise import render
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.threads import map_threads

# Anything that can be looked at: explicit Gaussians, or a function from camera to picture (anchor models).
View = GaussianScene | Callable[[Camera], Floats]


@dataclass(frozen=True)
class Comparison:
    """Quality of a set of pictures against as many originals.

    Attributes:
        names: (V) camera names.
        psnr_db: (V) PSNR per view, dB; `math.inf` where the pictures are equal.
        ssim: (V) SSIM per view; empty if it was not asked for.
    """

    names: tuple[str, ...]
    psnr_db: tuple[float, ...]
    ssim: tuple[float, ...]

    @property
    def mean_psnr_db(self) -> float:
        """Mean of the PSNR in dB, as papers report it, over the views whose pictures differ; `math.inf` without any."""
        finite = [decibels for decibels in self.psnr_db if decibels < math.inf]
        return float(np.mean(finite)) if finite else math.inf

    @property
    def p5_psnr_db(self) -> float:
        """5th percentile of the views' PSNR, dB: the view that at most one in twenty falls behind."""
        return sorted(self.psnr_db)[(len(self.psnr_db) - 1) // 20]

    @property
    def worst_psnr_db(self) -> float:
        """PSNR of the worst view, dB."""
        return min(self.psnr_db)

    def part(self, first: int, count: int) -> Comparison:
        """The comparison of `count` of the views, from number `first` on, counted from 0."""
        rows = slice(first, first + count)
        return Comparison(self.names[rows], self.psnr_db[rows], self.ssim[rows])

    @property
    def mean_ssim(self) -> float:
        """Mean over the views; NaN if SSIM was not asked for."""
        return float(np.mean(self.ssim)) if self.ssim else float("nan")

    @property
    def worst_ssim(self) -> float:
        """SSIM of the worst view; NaN if SSIM was not asked for."""
        return min(self.ssim, default=float("nan"))


def compare(
    a: View,
    b: View,
    cameras: Sequence[Camera],
    ssim: bool = True,
    background: Sequence[float] = (0.0, 0.0, 0.0),
) -> Comparison:
    """Compare the pictures of `a` with those of `b`, seen from the same cameras.

    Args:
        a, b: scenes, or functions from camera to (height, width, 3) picture.
        cameras: the views, at least one.
        ssim: also compute SSIM, which takes about as long as a picture.
        background: colour behind the scenes; functions bring their own.

    Raises:
        InvalidInput: no cameras.
    """
    draw_a, draw_b = _drawer(a, background), _drawer(b, background)
    pairs = map_threads(lambda camera: (camera.name, draw_a(camera), draw_b(camera)), cameras)
    return compare_pictures(pairs, ssim)


def compare_with_photos(
    scene: View,
    photos: str | Path,
    split: str = "test",
    ssim: bool = True,
    background: Sequence[float] = (0.0, 0.0, 0.0),
    names: Collection[str] = (),
) -> Comparison:
    """Compare the pictures of `scene` with the photos it was made from.

    Args:
        scene: a scene, or a function from camera to (height, width, 3) picture.
        photos: a folder with cameras (:func:`scarfmt.render.capture.load_cameras`) and `images/`, or their file.
        split: take the cameras marked so; empty takes all, and so does a file that marks none.
        names: take the cameras of these photos, whatever the file marks.

    Raises:
        InvalidInput: no camera has that split or name, the cameras cannot be read, or a photo has another size than its
            camera.
        OSError: a file cannot be read.
    """
    everything = load_cameras(photos)
    marked = any(camera.split for camera in everything)
    if names:
        cameras = [camera for camera in everything if camera.name in names]
    else:
        cameras = [camera for camera in everything if split in ("", camera.split) or not marked]
    folder = (Path(photos) if Path(photos).is_dir() else Path(photos).parent) / "images"
    draw = _drawer(scene, background)
    pairs = map_threads(lambda camera: (camera.name, draw(camera), read_image(folder / camera.name)), cameras)
    return compare_pictures(pairs, ssim)


def compare_pictures(pairs: Iterable[tuple[str, Floats, Floats]], with_ssim: bool = True) -> Comparison:
    """Compare pictures given as (name, picture, original).

    Raises:
        InvalidInput: no pairs, or two pictures of different sizes.
    """
    names, decibels, similarities = [], [], []
    for name, picture, original in pairs:
        names.append(name)
        decibels.append(psnr(picture, original))
        if with_ssim:
            similarities.append(ssim(picture, original))
    if not names:
        raise InvalidInput("input-empty", "no pictures to compare: give at least one camera")
    return Comparison(tuple(names), tuple(decibels), tuple(similarities))


def _drawer(view: View, background: Sequence[float]) -> Callable[[Camera], Floats]:
    if not isinstance(view, GaussianScene):
        return view
    return partial(render, Drawable.of(view), background=background)
