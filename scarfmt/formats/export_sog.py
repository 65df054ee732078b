"""Writing PlayCanvas SOG 2, bundled: `meta.json` and lossless WebP images, stored in a ZIP, as `sog` describes them.

The whole scene has to be in memory: codebooks and the palette are made of all its Gaussians.
"""

from __future__ import annotations

import io
import json
import math
import zipfile
from typing import Any, BinaryIO

import numpy as np

from scarfmt.arrays import F32, F64, I64, U8
from scarfmt.container.registries import RenderModel
from scarfmt.errors import missing_package
from scarfmt.formats.compressed_ply import morton_order
from scarfmt.formats.output import Described, Losses, Parts, Says, Written, finite, gaussian_sizes
from scarfmt.formats.quantise import alpha_of_logit, levels, smallest_three, unit_quaternions
from scarfmt.formats.sog import BANDS_OF_COEFFICIENTS, PALETTE_COLUMNS
from scarfmt.scene.gaussians import GaussianScene, concatenate

MODELS = {RenderModel.ANTIALIASED: "antialiased", RenderModel.TWO_DIMENSIONAL: "2dgs"}
_ROUNDS = 6
_ROWS = 1 << 14
"""Rows that are compared with all centres at once."""
_SEED = 1


def write_sog(parts: Parts, described: Described, target: BinaryIO) -> Written:
    """Write a bundled SOG, in the axes of the scene; Gaussians are put in Morton order.

    Raises:
        InvalidInput: ``output-range``: a value is not finite, or one Gaussian so far from all others that their
            positions would be lost; ``output-empty``; ``input-dependency``: Pillow is missing.
    """
    scene = concatenate(list(finite(parts, "SOG")))
    scene = scene.take(morton_order(scene.positions))
    losses = Losses()
    images: dict[str, U8] = {}
    meta: dict[str, Any] = {"version": 2, "asset": {"generator": "scarfmt"}, "count": len(scene)}
    if (model := MODELS.get(described.description.render_model)) is not None:
        meta["model"] = model
    meta["means"] = _means(scene, images, losses)
    losses.refuse_coarse("SOG", "leave out Gaussians far from all others, or write another format")
    meta["scales"] = _code(scene.log_scales, "scales", images)
    meta["quats"] = _rotations(scene, images)
    meta["sh0"] = _code(scene.sh[:, 0], "sh0", images, alpha_of_logit(scene.opacity_logits))
    if scene.sh_degree:
        meta["shN"] = _harmonics(scene.sh[:, 1:], images)
    with zipfile.ZipFile(target, "w", zipfile.ZIP_STORED) as archive:
        _store(archive, "meta.json", json.dumps(meta, separators=(",", ":")).encode())
        for name, pixels in images.items():
            _store(archive, name, _webp(pixels))
    grid = "SOG rounds scales and colours to 256 values each, opacities to 1/255, rotations to 1/180"
    grid += f", and spherical harmonics to {meta['shN']['count']:,} sets" if scene.sh_degree else ""
    says = Says.RENDER_MODEL
    return Written(len(scene), (f"{grid}; the order changes", *losses.notes(described, len(scene), "SOG", says)))


def _store(archive: zipfile.ZipFile, name: str, data: bytes) -> None:
    # A date of its own would make two runs differ.
    archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), data)


def _webp(pixels: U8) -> bytes:
    """A lossless image of (H, W, 4) bytes; colours under alpha 0 are kept."""
    try:
        from PIL import Image
    except ModuleNotFoundError as error:
        raise missing_package("pillow", "import") from error
    stream = io.BytesIO()
    Image.fromarray(pixels, "RGBA").save(stream, "WEBP", lossless=True, exact=True, quality=70, method=2)
    return stream.getvalue()


def _square(pixels: U8) -> U8:
    """(N, 3 or 4) bytes as a (H, W, 4) image, sides multiples of 4, opaque where no alpha is given."""
    width = 4 * math.ceil(math.sqrt(len(pixels)) / 4)
    height = 4 * math.ceil(len(pixels) / width / 4)
    image = np.full((height * width, 4), 255, np.uint8)
    image[: len(pixels), : pixels.shape[1]] = pixels
    return image.reshape(height, width, 4)


def _means(scene: GaussianScene, images: dict[str, U8], losses: Losses) -> dict[str, Any]:
    logarithmic = np.sign(scene.positions) * np.log1p(np.abs(scene.positions))
    low, high = logarithmic.min(axis=0), logarithmic.max(axis=0)
    span = np.where(high > low, high - low, 1.0)
    number = levels((logarithmic - low) / span, 1 << 16)
    images["means_l.webp"] = _square((number & 255).astype(np.uint8))
    images["means_u.webp"] = _square((number >> 8).astype(np.uint8))
    steps = (span / 65535 * (1 + np.abs(scene.positions))).max(axis=1)
    losses.compare_steps(steps, gaussian_sizes(scene.log_scales))
    return {"mins": low.tolist(), "maxs": high.tolist(), "files": ["means_l.webp", "means_u.webp"]}


def _rotations(scene: GaussianScene, images: dict[str, U8]) -> dict[str, Any]:
    kept, omitted = smallest_three(unit_quaternions(scene.rotations))
    pixels = np.concatenate([levels(kept * math.sqrt(0.5) + 0.5, 256), 252 + omitted[:, None]], axis=1)
    images["quats.webp"] = _square(pixels.astype(np.uint8))
    return {"files": ["quats.webp"]}


def _code(values: F32, name: str, images: dict[str, U8], alpha: U8 | None = None) -> dict[str, Any]:
    """Values (N, 3) through a codebook of 256."""
    book = fit_codebook(values.ravel().astype(np.float64))
    pixels = nearest(book, values.astype(np.float64)).astype(np.uint8)
    images[f"{name}.webp"] = _square(pixels if alpha is None else np.concatenate([pixels, alpha[:, None]], axis=1))
    return {"codebook": book.tolist(), "files": [f"{name}.webp"]}


def _harmonics(rest: F32, images: dict[str, U8]) -> dict[str, Any]:
    """Coefficients (N, R, 3) as labels into a palette, and the palette through a codebook of 256."""
    rows = rest.reshape(len(rest), -1)
    palette, labels = fit_palette(rows)
    book = fit_codebook(palette.ravel().astype(np.float64))
    coefficients = rest.shape[1]
    height = -(-len(palette) // PALETTE_COLUMNS)
    entries = np.zeros((height * PALETTE_COLUMNS, coefficients, 4), np.uint8)
    entries[..., 3] = 255
    entries[: len(palette), :, :3] = nearest(book, palette.astype(np.float64)).reshape(-1, coefficients, 3)
    images["shN_centroids.webp"] = entries.reshape(height, PALETTE_COLUMNS * coefficients, 4)
    images["shN_labels.webp"] = _square(np.stack([labels & 255, labels >> 8, labels * 0], axis=1).astype(np.uint8))
    return {
        "count": len(palette),
        "bands": BANDS_OF_COEFFICIENTS[coefficients],
        "codebook": book.tolist(),
        "files": ["shN_centroids.webp", "shN_labels.webp"],
    }


def fit_codebook(values: F64) -> F64:
    """(256,) rising values, k-means of (n,) `values`: Lloyd 1982, from quantiles, on a sorted copy."""
    ordered = np.sort(values)
    sums = np.concatenate([[0.0], np.cumsum(ordered)])
    book = np.unique(ordered[np.linspace(0, len(ordered) - 1, 256).astype(np.int64)])
    # Quantiles starve the tails, where errors are large: half of the values are spread evenly instead.
    book = np.sort(np.concatenate([book[::2], np.linspace(ordered[0], ordered[-1], 256 - len(book[::2]))]))
    for _ in range(4 * _ROUNDS):
        edges = np.searchsorted(ordered, (book[1:] + book[:-1]) / 2)
        first, past = np.concatenate([[0], edges]), np.concatenate([edges, [len(ordered)]])
        counts = past - first
        book = np.where(counts > 0, (sums[past] - sums[first]) / np.maximum(counts, 1), book)
    return np.sort(book)


def nearest(book: F64, values: F64) -> I64:
    """The number of the value of a rising `book` that is nearest to each of `values`, of any shape."""
    return np.searchsorted((book[1:] + book[:-1]) / 2, values)


def fit_palette(rows: F32) -> tuple[F32, I64]:
    """A palette (P, D) for `rows` (N, D), and (N,) which entry stands for each row.

    k-means in two levels, so that no row is compared with all of the palette: among coarse clusters, then within each.
    """
    most = 1024 * min(64, 1 << max(0, (len(rows) >> 10).bit_length() - 1))
    if len(rows) <= most:
        return rows, np.arange(len(rows))
    random = np.random.default_rng(_SEED)
    _, coarse = _cluster(rows, math.isqrt(most), random)
    labels, palette, filled = np.zeros(len(rows), np.int64), [], 0
    for number in range(int(coarse.max()) + 1):
        here = np.flatnonzero(coarse == number)
        centres, within = _cluster(rows[here], max(1, len(here) * (most - math.isqrt(most)) // len(rows)), random)
        labels[here] = filled + within
        palette.append(centres)
        filled += len(centres)
    return np.concatenate(palette), labels


def _cluster(rows: F32, count: int, random: np.random.Generator) -> tuple[F32, I64]:
    """At most `count` centres (K, D) of `rows` (N, D), and (N,) the nearest of each: Lloyd 1982."""
    centres = rows[random.permutation(len(rows))[:count]]
    for _ in range(_ROUNDS):
        labels = _nearest_rows(centres, rows)
        order, counts = np.argsort(labels, kind="stable"), np.bincount(labels, minlength=len(centres))
        used = counts > 0
        starts = np.concatenate([[0], np.cumsum(counts[used])[:-1]])
        centres = (np.add.reduceat(rows[order], starts) / counts[used, None]).astype(np.float32)
    return centres, _nearest_rows(centres, rows)


def _nearest_rows(centres: F32, rows: F32) -> I64:
    """(N,) which of the centres (K, D) is nearest to each of `rows` (N, D)."""
    half = (centres**2).sum(axis=1) / 2
    parts = range(0, len(rows), _ROWS)
    return np.concatenate([np.argmin(half - rows[part : part + _ROWS] @ centres.T, axis=1) for part in parts])
