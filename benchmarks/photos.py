"""Rate and distortion of every layer of a `.scar` against the photos that were held out.

    python -m benchmarks.photos scene.scar CAPTURE
    python -m benchmarks.photos scene.scar CAPTURE --resolution 800 --json figures.json --beside truck

Of each number of layers: the bytes of the file cut there, and of what it decodes to the mean over the photos of PSNR
and SSIM, of pictures rounded to 8 bits; of FLIP (Andersson et al. 2020; NVIDIA's package `flip-evaluator`, 67 pixels a
degree) where that is installed; and of LPIPS with `--lpips FILE...` (`benchmarks.lpips`), also with pictures in 0..1,
as the tables of 3DGS have it. A picture that equals its photo counts as 100 dB: JSON has no infinity, and a mean of it
says nothing. `--beside` prints published figures below, from `benchmarks.published`.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.judged import EQUAL_DB
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
Metrics = Mapping[str, Perceptual]
"""Perceptual metrics of (original, picture), by the name of a member of `Figures`."""


@dataclass(frozen=True)
class Figures:
    """The bytes and the quality of a file.

    Attributes:
        file_bytes: of the file.
        psnr_db, worst_psnr_db, ssim: mean and worst over the photos; at most `EQUAL_DB`.
        flip, lpips, lpips_3dgs: means over the photos, the last of pictures in 0..1; None where they were not measured.
    """

    file_bytes: int
    psnr_db: float
    worst_psnr_db: float
    ssim: float
    flip: float | None = None
    lpips: float | None = None
    lpips_3dgs: float | None = None


def flip_metric() -> Perceptual | None:
    """Mean FLIP error of a picture, of (original, picture); None where its package is not installed."""
    try:
        import flip_evaluator
    except ImportError:
        return None

    def error(original: F32, picture: F32) -> float:
        return float(flip_evaluator.evaluate(original, picture, "LDR", applyMagma=False)[1])

    return error


def metrics(lpips: Sequence[Path]) -> dict[str, Perceptual]:
    """The perceptual metrics that there are here; says on stderr when FLIP is not.

    Args:
        lpips: files of weights; none for no LPIPS.
    """
    found: dict[str, Perceptual] = {}
    flip = flip_metric()
    if flip is None:
        print("no FLIP: pip install flip-evaluator", file=sys.stderr)
    else:
        found["flip"] = flip
    if lpips:
        from benchmarks.lpips import load_lpips

        distance = load_lpips(lpips).distance
        found |= {"lpips": distance, "lpips_3dgs": partial(distance, mapped=False)}
    return found


def drawn(scene: GaussianScene | AnchorModel, camera: Camera) -> F32:
    """(height, width, 3) float32 picture over black, rounded to 8 bits, 0..1."""
    if isinstance(scene, AnchorModel):
        seen = gaussians(scene, camera.centre)
        picture = render(seen.scene, camera, colours=seen.colours)
    else:
        picture = render(scene, camera)
    return np.asarray(np.rint(np.clip(picture, 0, 1) * np.float32(255)) / np.float32(255), np.float32)


def measured(
    scene: GaussianScene | AnchorModel, file_bytes: int, photos: Sequence[Photo], perceptual: Metrics
) -> Figures:
    """Figures of a scene.

    Args:
        scene: what its file decodes to.
        file_bytes: of the file.
        photos: what its pictures are compared with, at least one.
        perceptual: further metrics.
    """
    every: list[dict[str, float]] = []
    for photo in photos:
        original, picture = pixels(photo).astype(np.float32) / np.float32(255), drawn(scene, photo.camera)
        level = min(psnr(picture, original), EQUAL_DB)
        more = {name: metric(original, picture) for name, metric in perceptual.items()}
        every.append({"psnr_db": level, "ssim": ssim(picture, original), **more})
    means = {name: float(np.mean([one[name] for one in every])) for name in every[0]}
    return Figures(file_bytes, worst_psnr_db=min(one["psnr_db"] for one in every), **means)


def figures(data: bytes, photos: Sequence[Photo], perceptual: Metrics) -> Iterator[Figures]:
    """Figures of each layer of a file, from the first; arguments as for `measured`."""
    for layers in range(1, int(inspect(data)["layer_count"]) + 1):
        cut = truncate(data, layers)
        yield measured(decode_scene(cut), len(cut), photos, perceptual)


HEAD = ("kB", "PSNR, dB", "worst", "SSIM", "FLIP", "LPIPS", "LPIPS, 0..1")


def cells(row: Figures) -> list[str]:
    """The cells of a table under `HEAD`."""
    perceptual = ("–" if value is None else f"{value:.4f}" for value in (row.flip, row.lpips, row.lpips_3dgs))
    decibels = (f"{value:.2f}" for value in (row.psnr_db, row.worst_psnr_db))
    return [f"{row.file_bytes / 1000:,.1f}", *decibels, f"{row.ssim:.4f}", *perceptual]


def figures_table(rows: Sequence[Figures]) -> str:
    """A Markdown table of the layers of a file, from the first."""
    return table(("layers", *HEAD), [[str(number), *cells(row)] for number, row in enumerate(rows, 1)])


def held_out(path: Path, resolution: int | None) -> list[Photo]:
    """The photos of a capture that nothing learns from.

    Raises:
        SystemExit: there are none.
    """
    photos = list(load_capture(path, resolution).test)
    if not photos:
        sys.exit(f"{path}: no photo is held out")
    return photos


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options that every script shares which compares with photos."""
    parser.add_argument("--resolution", type=int, help="longest side of the photos, pixels")
    parser.add_argument("--lpips", type=Path, nargs="+", default=[], metavar="FILE", help="weights for LPIPS")


def main(arguments: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).partition("\n")[0])
    parser.add_argument("file", type=Path, help="a .scar")
    parser.add_argument("capture", type=Path, help="capture as for `scarfmt train`, with the photos")
    add_arguments(parser)
    parser.add_argument("--json", type=Path, help="where to write the figures")
    parser.add_argument("--beside", choices=SCENES, help="print published figures of this scene below")
    said = parser.parse_args(arguments)
    photos = held_out(said.capture, said.resolution)
    rows = list(figures(said.file.read_bytes(), photos, metrics(said.lpips)))
    sys.stdout.write(figures_table(rows))
    if said.beside:
        sys.stdout.write("\n" + published_table(said.beside))
    if said.json:
        document: dict[str, Any] = {
            "file": said.file.name,
            "photos": len(photos),
            "size": [photos[0].camera.width, photos[0].camera.height],
            "layers": [{"layers": number, **asdict(row)} for number, row in enumerate(rows, 1)],
        }
        said.json.write_text(json.dumps(document, indent=1, allow_nan=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
