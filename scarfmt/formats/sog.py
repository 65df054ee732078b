"""PlayCanvas SOG: `meta.json` and lossless images with one pixel for each Gaussian, in a ZIP or a directory.

Version 2 (PlayCanvas user manual, "The SOG Format"), read row-major from the top left:

- means: low and high bytes of 16 bits for each axis, linear in [mins, maxs] of sign(x) log(1 + |x|).
- quats: three components in [-sqrt(1/2), sqrt(1/2)]; alpha - 252 names the omitted largest of w, x, y, z.
- scales, sh0 colour: indices into 256-entry codebooks of log scales and f_dc; sh0 alpha is the opacity.
- shN: 16-bit labels into a palette of 64 entries a row, whose bytes index a codebook.

Version 1 (no `version` field) has linear [mins, maxs] ranges in place of codebooks, and the opacity as a logit.
Axes are kept as stored: writers copy those of the PLY they convert.
"""

from __future__ import annotations

import io
from pathlib import PurePosixPath
from typing import Any

import numpy as np

from scarfmt.arrays import F32, F64, U8
from scarfmt.container.registries import RenderModel
from scarfmt.errors import InvalidInput, Unsupported, missing_package
from scarfmt.formats.quantise import complete_smallest_three, logit_of_alpha
from scarfmt.formats.source import Folder, Source, is_zip, member_names, open_folder
from scarfmt.scene.description import Description
from scarfmt.scene.gaussians import GaussianScene

META = "meta.json"
PALETTE_COLUMNS = 64
BANDS_OF_COEFFICIENTS = {3: 1, 8: 2, 15: 3}
_SPARE_PIXELS = 1 << 20


def sniff(source: Source) -> bool:
    """Whether the content is a `meta.json`, or a ZIP archive with one."""
    if is_zip(source):
        return any(PurePosixPath(name).name == META for name in member_names(source))
    document = source.document or {}
    # The images of gsplat's PngCompression have a meta.json with the same member.
    return isinstance(document.get("means"), dict) and "opacities" not in document


def load(source: Source) -> GaussianScene:
    """Read a bundled SOG, or the `meta.json` of one in a directory.

    Raises:
        InvalidInput: damaged, or an image is missing.
        Unsupported: a newer version.
        LimitExceeded: more Gaussians than any scene has.
    """
    with open_folder(source, META) as (folder, meta):
        return read(folder, meta)


def read(folder: Folder, meta: Source) -> GaussianScene:
    """Read the scene of a `meta.json` whose images are in a folder."""
    return _Reader(folder, meta).scene()


def describe(source: Source) -> Description:
    """What `model` says: how the scene was trained."""
    if not is_zip(source):
        return Description(model_of(source))
    with open_folder(source, META) as (_, meta):
        return Description(model_of(meta))


def model_of(meta: Source) -> RenderModel:
    """The render model that a `meta.json` or `lod-meta.json` names: `model`, or `antialias` as the manual has it.

    Raises:
        Unsupported: ``input-version``: an unknown one.
    """
    document = meta.document or {}
    name = document.get("model", "antialiased" if document.get("antialias") is True else None)
    if name not in _MODELS:
        raise Unsupported("input-version", f"{meta.name}: model {str(name)[:40]!r}; this importer knows {_MODEL_NAMES}")
    return _MODELS[name]


_MODELS = {
    None: RenderModel.CLASSIC,
    "default": RenderModel.CLASSIC,
    "antialiased": RenderModel.ANTIALIASED,
    "2dgs": RenderModel.TWO_DIMENSIONAL,
}
_MODEL_NAMES = ", ".join(str(name) for name in _MODELS if name)


def _is_lossy(data: bytes) -> bool:
    """Whether a WebP has pixels that are not those given to its encoder (RFC 9649, chunk `VP8 `)."""
    at = 12 if data[:4] == b"RIFF" and data[8:12] == b"WEBP" else len(data)
    while at + 8 <= len(data):
        if data[at : at + 4] in (b"VP8 ", b"VP8L"):
            return data[at : at + 4] == b"VP8 "
        size = int.from_bytes(data[at + 4 : at + 8], "little")
        at += 8 + size + size % 2
    return False


class _Reader:
    """Decodes one SOG from its metadata and the folder of its images."""

    def __init__(self, folder: Folder, source: Source):
        self.source = source
        self._folder = folder
        self.meta = source.json(field=META)
        version = self.meta.get("version", 1)
        if version not in (1, 2):
            raise Unsupported("input-version", f"{source.name}: SOG version {version!r}; this importer reads 1 and 2")
        self.count = self._count(version)

    def scene(self) -> GaussianScene:
        means = self._images("means", 2)
        bytes16 = means[0].astype(np.uint16) | means[1].astype(np.uint16) << 8
        logarithmic = self._scale("means", bytes16[:, :3] / 65535.0, 3)
        scale_bytes = self._images("scales", 1)[0][:, :3]
        rotations = self._rotations(self._images("quats", 1)[0])
        colour = self._images("sh0", 1)[0]
        with np.errstate(over="ignore"):  # absurd ranges give infinities, which a later check reports
            log_scales = self._values("scales", scale_bytes).astype(np.float32)
            positions = np.sign(logarithmic) * np.expm1(np.abs(logarithmic))
            dc, logits = self._colour(colour)
            sh = np.concatenate([dc.astype(np.float32)[:, None, :], self._harmonics()], axis=1)
        return GaussianScene(positions, log_scales, rotations, logits, sh)

    def _count(self, version: int) -> int:
        shape = self._entry("means").get("shape", [None])
        count = self.meta.get("count") if version == 2 else shape[0] if isinstance(shape, list) and shape else None
        if not isinstance(count, int) or isinstance(count, bool) or count < 0:
            raise self.source.corrupt(f"the number of Gaussians is {count!r}", field=f"{META}.count")
        return count

    def _entry(self, key: str) -> dict[str, Any]:
        entry = self.meta.get(key)
        if not isinstance(entry, dict):
            raise self.source.corrupt("missing", field=f"{META}.{key}")
        return entry

    def _numbers(self, key: str, name: str, length: int) -> F64:
        """`length` numbers; a single one is repeated, as version 1 has for shN."""
        value = self._entry(key).get(name)
        return self._check_numbers(key, name, [value] * length if isinstance(value, int | float) else value, length)

    def _check_numbers(self, key: str, name: str, values: object, length: int) -> F64:
        good = isinstance(values, list) and len(values) == length and all(type(v) in (int, float) for v in values)
        if not good:
            raise self.source.corrupt(f"expected {length} numbers", field=f"{META}.{key}.{name}")
        try:
            return np.array(values, np.float64)
        except OverflowError as error:
            raise self.source.corrupt("a number is too large", field=f"{META}.{key}.{name}") from error

    def _scale(self, key: str, fraction: F64, channels: int) -> F64:
        low, high = (self._numbers(key, end, channels) for end in ("mins", "maxs"))
        return low * (1.0 - fraction) + high * fraction

    def _values(self, key: str, indices: U8) -> F64:
        """Bytes (N, C) through the codebook, or through the ranges version 1 has instead."""
        if "codebook" in self._entry(key):
            return self._codebook(key)[indices]
        return self._scale(key, indices / 255.0, indices.shape[1])

    def _codebook(self, key: str) -> F64:
        """(256,) values. Old writers left the first one null: it continues the others, as PlayCanvas reads it."""
        stored = self._entry(key)["codebook"]
        if not isinstance(stored, list) or stored[:1] != [None]:
            return self._numbers(key, "codebook", 256)
        rest = self._check_numbers(key, "codebook", stored[1:], 255)
        return np.concatenate([[rest[0] + (rest[0] - rest[-1]) / 255], rest])

    def _colour(self, pixels: U8) -> tuple[F64, F32]:
        """Degree 0 coefficients and opacity logits."""
        if "codebook" in self._entry("sh0"):
            return self._values("sh0", pixels[:, :3]), logit_of_alpha(pixels[:, 3])
        values = self._values("sh0", pixels)
        return values[:, :3], values[:, 3].astype(np.float32)

    def _rotations(self, pixels: U8) -> F32:
        omitted = pixels[:, 3].astype(np.int64) - 252
        bad = np.flatnonzero(omitted < 0)
        if len(bad):
            raise self.source.corrupt(
                f"{len(bad)} rotations with a reserved mode, the first at Gaussian {bad[0]}", field="quats"
            )
        kept = (pixels[:, :3] / 255.0 - 0.5) * np.sqrt(2.0)
        return complete_smallest_three(kept, omitted).astype(np.float32)

    def _harmonics(self) -> F32:
        """(N, R, 3) float32 from palette and labels; R is 0 where the scene has none."""
        if self.meta.get("shN") is None:
            return np.empty((self.count, 0, 3), np.float32)
        names = self._files("shN", 2)
        # Writers list the centroids first, the manual listed the labels first: the name decides.
        centroids_name, labels_name = names if "label" not in names[0] else names[::-1]
        labels = self._pixels(labels_name)[:, :2].astype(np.int64)
        palette = self._palette(self._decode(centroids_name, square=False))
        index = labels[:, 0] | labels[:, 1] << 8
        if self.count and index.max() >= len(palette):
            raise self.source.corrupt(f"label {index.max()} in a palette of {len(palette)}", field="shN")
        coefficients: F32 = palette[index]
        return coefficients

    def _palette(self, image: U8) -> F32:
        """(P, R, 3) float32 palette of SH coefficients."""
        height, width, _ = image.shape
        coefficients = width // PALETTE_COLUMNS
        if coefficients not in BANDS_OF_COEFFICIENTS or width % PALETTE_COLUMNS:
            raise self.source.corrupt(f"the SH palette is {width} pixels wide, expected 192, 512 or 960", field="shN")
        # Some writers leave `bands` out, or write 0 or null: the palette says it.
        bands = self._entry("shN").get("bands") or BANDS_OF_COEFFICIENTS[coefficients]
        if bands != BANDS_OF_COEFFICIENTS[coefficients]:
            raise self.source.corrupt(f"{bands!r} SH bands in a palette {width} pixels wide", field="shN.bands")
        entries = image[..., :3].reshape(height * PALETTE_COLUMNS * coefficients, 3)
        return self._values("shN", entries).astype(np.float32).reshape(-1, coefficients, 3)

    def _files(self, key: str, number: int) -> list[str]:
        """Bare names of the images of one property: directories in them are ignored, and cannot lead elsewhere."""
        files = self._entry(key).get("files")
        if not isinstance(files, list) or len(files) < number or not all(isinstance(name, str) for name in files):
            raise self.source.corrupt(f"expected {number} file names", field=f"{META}.{key}.files")
        names = [PurePosixPath(name.replace("\\", "/")).name for name in files[:number]]
        return [self.source.beside(name, f"{META}.{key}.files").name for name in names]

    def _images(self, key: str, number: int) -> list[U8]:
        return [self._pixels(name) for name in self._files(key, number)]

    def _pixels(self, name: str) -> U8:
        """(count, 4) uint8: the pixels that belong to Gaussians."""
        return self._decode(name, square=True).reshape(-1, 4)[: self.count]

    def _decode(self, name: str, *, square: bool) -> U8:
        """(H, W, 4) uint8 of one image, its size checked before it is decoded.

        Args:
            name: bare file name.
            square: whether it has one pixel for each Gaussian.
        """
        try:
            from PIL import Image, UnidentifiedImageError
        except ModuleNotFoundError as error:
            raise missing_package("pillow", "import") from error
        data = self._folder.source(name).read()
        if _is_lossy(data):
            raise self.source.corrupt("a WebP with losses, as image optimisers make: its numbers are lost", field=name)
        try:
            with Image.open(io.BytesIO(data), formats=("WEBP", "PNG")) as image:
                self._check_size(name, image.size, square)
                pixels: U8 = np.asarray(image.convert("RGBA"))
        except (OSError, ValueError, SyntaxError, EOFError, Image.DecompressionBombError) as error:
            if isinstance(error, InvalidInput):
                raise
            # pillow's own text names the stream in memory, which means nothing to a person.
            reason = "unknown kind" if isinstance(error, UnidentifiedImageError) else error
            raise self.source.corrupt(f"damaged image ({reason})", field=name) from error
        return pixels

    def _check_size(self, name: str, size: tuple[int, int], square: bool) -> None:
        pixels = size[0] * size[1]
        if square and pixels < self.count:
            raise self.source.corrupt(f"{pixels} pixels for {self.count} Gaussians", field=name)
        if pixels > 2 * self.count + _SPARE_PIXELS:
            raise self.source.corrupt(f"{pixels} pixels, far more than {self.count} Gaussians need", field=name)
        # An image of one colour is a few bytes whatever its size, so the whole scene is what counts.
        self.source.check_count(self.count, file_bytes=self._folder.size)
