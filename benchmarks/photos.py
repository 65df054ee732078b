"""Rate and distortion of every layer of a `.scar` against the photos that were held out.

Of each number of layers: the bytes of the file cut there, and of what it decodes to PSNR and SSIM, of pictures rounded
to 8 bits, and FLIP (Andersson et al. 2020; NVIDIA's package `flip-evaluator`, 67 pixels a degree) where that is
installed. A picture that equals its photo counts as 100 dB: JSON has no infinity, and a mean of it says nothing.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image

from benchmarks.judge import EQUAL_DB
from reference_decoder.anchors import gaussians
from reference_decoder.decode import decode_scene
from reference_encoder.training.capture import Photo, pixels
from scarfmt.api import inspect, truncate
from scarfmt.arrays import F32
from scarfmt.render.camera import Camera
from scarfmt.render.metrics import psnr, ssim
from scarfmt.render.rasterise import render
from scarfmt.scene.gaussians import AnchorModel, GaussianScene

Perceptual = Callable[[F32, F32], float]
"""A metric of (original, picture), each (height, width, 3) float32, 0..1."""
HEAD = ("kB", "PSNR, dB", "worst", "SSIM", "FLIP")
GAP = 6
"""White pixels between two pictures."""


@dataclass(frozen=True)
class Figures:
    """The bytes and the quality of a file.

    Attributes:
        file_bytes: of the file.
        psnr_db, worst_psnr_db, ssim: mean and worst over the photos; at most `EQUAL_DB`.
        flip: mean over the photos; None where its package is not installed.
    """

    file_bytes: int
    psnr_db: float
    worst_psnr_db: float
    ssim: float
    flip: float | None = None

    def cells(self) -> list[str]:
        """The cells of a table under `HEAD`."""
        levels = [f"{value:.2f}" for value in (self.psnr_db, self.worst_psnr_db)]
        flip = "–" if self.flip is None else f"{self.flip:.4f}"
        return [f"{self.file_bytes / 1000:,.1f}", *levels, f"{self.ssim:.4f}", flip]


def load_flip() -> Perceptual | None:
    """Mean FLIP error of a picture; None, with a line on stderr, where its package is not installed."""
    try:
        import flip_evaluator
    except ImportError:
        print("no FLIP: pip install flip-evaluator", file=sys.stderr)
        return None

    def error(original: F32, picture: F32) -> float:
        return float(flip_evaluator.evaluate(original, picture, "LDR", applyMagma=False)[1])

    return error


def draw(scene: GaussianScene | AnchorModel, camera: Camera) -> F32:
    """(height, width, 3) float32 picture over black, rounded to 8 bits, 0..1."""
    if isinstance(scene, AnchorModel):
        seen = gaussians(scene, camera.centre)
        picture = render(seen.scene, camera, colours=seen.colours)
    else:
        picture = render(scene, camera)
    return np.asarray(np.rint(np.clip(picture, 0, 1) * np.float32(255)) / np.float32(255), np.float32)


def measure(
    scene: GaussianScene | AnchorModel, file_bytes: int, photos: Sequence[Photo], flip: Perceptual | None = None
) -> Figures:
    """Compare what a file of `file_bytes` decodes to with `photos`, at least one."""
    levels, structure, errors = [], [], []
    for photo in photos:
        original, picture = pixels(photo).astype(np.float32) / np.float32(255), draw(scene, photo.camera)
        levels.append(min(psnr(picture, original), EQUAL_DB))
        structure.append(ssim(picture, original))
        errors += [] if flip is None else [flip(original, picture)]
    error = float(np.mean(errors)) if errors else None
    return Figures(file_bytes, float(np.mean(levels)), min(levels), float(np.mean(structure)), error)


def measure_layers(data: bytes, photos: Sequence[Photo], flip: Perceptual | None = None) -> Iterator[Figures]:
    """Figures of each layer of a file, from the first; arguments as for :func:`measure`."""
    for layers in range(1, int(inspect(data)["layer_count"]) + 1):
        cut = truncate(data, layers)
        yield measure(decode_scene(cut), len(cut), photos, flip)


def draw_side_by_side(data: bytes, photo: Photo, width: int) -> Image.Image:
    """The layers of a file from the first, then the photo, together at most `width` pixels wide."""
    layers = range(1, int(inspect(data)["layer_count"]) + 1)
    pictures = [draw(decode_scene(truncate(data, layer)), photo.camera) * 255 for layer in layers]
    gap = np.full((photo.camera.height, GAP, 3), 255, np.uint8)
    parts = [part for picture in pictures for part in (np.rint(picture).astype(np.uint8), gap)]
    image = Image.fromarray(np.concatenate([*parts, pixels(photo)], axis=1))
    image.thumbnail((width, width), Image.Resampling.LANCZOS)
    return image
