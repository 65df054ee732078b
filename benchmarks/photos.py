"""Rate and distortion of every layer of a `.scar` against the photos that were held out.

    python -m benchmarks.photos scene.scar CAPTURE
    python -m benchmarks.photos scene.scar CAPTURE --resolution 800 --json figures.json --beside truck

Of each number of layers: the bytes of the file cut there, and of what it decodes to the mean over the photos of PSNR
and SSIM, of pictures rounded to 8 bits, and of FLIP (Andersson et al. 2020; NVIDIA's package `flip-evaluator`, 67
pixels a degree) where that is installed. `--beside` prints published figures below, from `benchmarks.published`.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.published import SCENES, published_table
from benchmarks.report import table
from reference_decoder.anchors import gaussians
from reference_encoder.training.capture import Photo, load_capture, pixels
from scarfmt.api import decode_scene, inspect, truncate
from scarfmt.arrays import F32
from scarfmt.render.camera import Camera
from scarfmt.render.metrics import psnr, ssim
from scarfmt.render.rasterise import render
from scarfmt.scene.gaussians import AnchorModel, GaussianScene

Perceptual = Callable[[F32, F32], float]


@dataclass(frozen=True)
class LayerFigures:
    """What a file cut after some layers takes and shows.

    Attributes:
        layers: kept, from the first.
        file_bytes: of the file cut there.
        psnr_db, worst_psnr_db, ssim: mean and worst over the photos.
        flip: mean over the photos; None where the package is missing.
    """

    layers: int
    file_bytes: int
    psnr_db: float
    worst_psnr_db: float
    ssim: float
    flip: float | None


def flip_metric() -> Perceptual | None:
    """Mean FLIP error of a picture, of (original, picture); None where its package is not installed."""
    try:
        import flip_evaluator
    except ImportError:
        return None

    def error(original: F32, picture: F32) -> float:
        return float(flip_evaluator.evaluate(original, picture, "LDR", applyMagma=False)[1])

    return error


def drawn(scene: GaussianScene | AnchorModel, camera: Camera) -> F32:
    """(height, width, 3) float32 picture over black, rounded to 8 bits, 0..1."""
    if isinstance(scene, AnchorModel):
        seen = gaussians(scene, camera.centre)
        picture = render(seen.scene, camera, colours=seen.colours)
    else:
        picture = render(scene, camera)
    return np.asarray(np.rint(np.clip(picture, 0, 1) * np.float32(255)) / np.float32(255), np.float32)


def figures(data: bytes, photos: Sequence[Photo], flip: Perceptual | None) -> Iterator[LayerFigures]:
    """Figures of each layer of a file, from the first.

    Args:
        data: the file.
        photos: what its pictures are compared with, at least one.
        flip: the perceptual metric, if there is one.
    """
    for layers in range(1, int(inspect(data)["layer_count"]) + 1):
        cut = truncate(data, layers)
        scene = decode_scene(cut)
        pairs = [(pixels(photo).astype(np.float32) / np.float32(255), drawn(scene, photo.camera)) for photo in photos]
        decibels = [psnr(picture, original) for original, picture in pairs]
        alike = [ssim(picture, original) for original, picture in pairs]
        errors = [flip(original, picture) for original, picture in pairs] if flip else []
        yield LayerFigures(
            layers,
            len(cut),
            float(np.mean(decibels)),
            min(decibels),
            float(np.mean(alike)),
            float(np.mean(errors)) if errors else None,
        )


def figures_table(rows: Sequence[LayerFigures]) -> str:
    """Of the figures, in Markdown."""
    head = ("layers", "kB", "PSNR, dB", "worst", "SSIM", "FLIP")
    cells = [
        (
            str(row.layers),
            f"{row.file_bytes / 1000:,.1f}",
            f"{row.psnr_db:.2f}",
            f"{row.worst_psnr_db:.2f}",
            f"{row.ssim:.4f}",
            "–" if row.flip is None else f"{row.flip:.4f}",
        )
        for row in rows
    ]
    return table(head, cells)


def main(arguments: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).partition("\n")[0])
    parser.add_argument("file", type=Path, help="a .scar")
    parser.add_argument("capture", type=Path, help="what `scarfmt train` takes, with the photos")
    parser.add_argument("--resolution", type=int, help="longest side of the photos, pixels")
    parser.add_argument("--json", type=Path, help="where to write the figures")
    parser.add_argument("--beside", choices=SCENES, help="print published figures of this scene below")
    said = parser.parse_args(arguments)
    capture = load_capture(said.capture, said.resolution)
    photos = [photo for photo in capture.photos if photo.camera.split == "test"]
    flip = flip_metric()
    if flip is None:
        print("no FLIP: pip install flip-evaluator", file=sys.stderr)
    rows = list(figures(said.file.read_bytes(), photos, flip))
    sys.stdout.write(figures_table(rows))
    if said.beside:
        sys.stdout.write("\n" + published_table(said.beside))
    if said.json:
        document: dict[str, Any] = {
            "file": said.file.name,
            "photos": len(photos),
            "size": [photos[0].camera.width, photos[0].camera.height],
            "layers": [asdict(row) for row in rows],
        }
        said.json.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
