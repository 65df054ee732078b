"""The files of a capture's photos: where they are, whether they can be learnt from, and their pixels, scaled down."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import cache
from os import PathLike
from pathlib import Path

import numpy as np
from PIL import ExifTags, Image, ImageOps

from scarfmt.arrays import F64, U8
from scarfmt.errors import InvalidInput, LossWarning
from scarfmt.render.camera import Camera
from scarfmt.render.capture import listings
from scarfmt.render.capture.record import Distorted
from scarfmt.render.capture.transforms import picture_file
from scarfmt.render.images import open_image, read_pixels


def filter_areas(picture: U8, width: int, height: int) -> U8:
    """(height, width, 3) uint8 of a larger picture, rounded to nearest; the picture itself if it has that size.

    Pixels of the old picture that lie across an edge count in part on both sides, so that sizes need not divide.
    """
    if picture.shape[:2] == (height, width):
        return picture
    rows = _average_parts(picture.astype(np.float64), height)
    smaller = _average_parts(rows.swapaxes(0, 1), width).swapaxes(0, 1)
    return np.asarray(smaller + 0.5, dtype=np.uint8)


def _average_parts(values: F64, count: int) -> F64:
    """(count, ...) float64: means of as many equal parts of the first axis."""
    length = len(values)
    sums = np.concatenate([np.zeros_like(values[:1]), np.cumsum(values, axis=0)])
    edges = np.arange(count + 1) * (length / count)
    below = np.minimum(edges.astype(np.intp), length - 1)
    part = (edges - below).reshape(-1, *(1,) * (values.ndim - 1))
    upto = sums[below] + part * values[below]
    means: F64 = np.diff(upto, axis=0) * (count / length)
    return means


_PHOTOS = (".jpg", ".jpeg", ".png", ".heic", ".heif", ".avif", ".webp", ".tif", ".tiff", ".dng")
_PLAIN = ("JPEG", "MPO", "PNG")
"""Kinds of pictures that COLMAP reads wherever it was built."""
_BLACK = 8
"""A photo whose brightest value is not above is black: what a lens cap leaves after JPEG."""
_SHOWN_NAMES = 3


View = Camera | Distorted


def wrong_capture(path: str | PathLike[str], message: str) -> InvalidInput:
    """The error for a capture that cannot be trained from: ``input-capture``."""
    return InvalidInput("input-capture", f"{path}: {message}")


def photo_files(path: Path, views: Sequence[View]) -> list[Path]:
    """The file of every view, which is there and has the size the view says.

    Args:
        path: of the capture: the files are in `images/` beside the list of cameras, or where their names say.
        views: of :func:`scarfmt.load_cameras`.

    Raises:
        InvalidInput: ``input-capture``, ``input-image``.
        OSError: a file cannot be read.
    """
    repeated = [name for name, count in Counter(view.name for view in views).items() if count > 1]
    if repeated or not all(view.name for view in views):
        what = f"is listed twice: {repeated[0]}" if repeated and repeated[0] else "has no name"
        raise wrong_capture(path, f"a photo {what}; each camera needs the name of its own photo")
    folders = _folders(path)
    paths = {view.name: _picture(folders, view.name) for view in views}
    missing = [name for name, file in paths.items() if file is None]
    if missing:
        where = " nor ".join(map(str, folders[:2]))
        message = f"{len(missing)} of {len(views)} photos are missing, {list_names(missing)}: neither in {where}"
        raise wrong_capture(path, message)
    files = [file for view in views if (file := paths[view.name]) is not None]
    for view, file in zip(views, files, strict=True):
        _check_size(path, view, file)
    return files


def bare_photos(path: Path) -> list[Path]:
    """The photos of a folder that lists no cameras, or of its `images/`, sorted by name; none where it lists some.

    HEIC is among them where pillow-heif is installed.
    """
    if not path.is_dir():
        return []
    try:
        listings(path)
    except InvalidInput:
        return [file for file in _photo_like(path) if file.suffix.lower() in _read_suffixes()]
    return []


def warn_of_unread(path: Path) -> None:
    """Warn of photos of :func:`bare_photos`' folder that are of a kind that is not read."""
    names = [file.name for file in _photo_like(path) if file.suffix.lower() not in _read_suffixes()]
    if names:
        message = f"left out {list_names(names)}: of a kind that is not read; save copies as JPEG or PNG"
        if any(name.lower().endswith((".heic", ".heif")) for name in names):
            message += ", or for HEIC: pip install 'scarfmt[heic]'"
        warnings.warn(f"{path}: {message}", LossWarning, stacklevel=4)


def _photo_like(path: Path) -> list[Path]:
    """Files of a folder, or of its `images/`, that are named like photos, sorted by name."""
    folder = path / "images" if (path / "images").is_dir() else path
    return sorted(file for file in folder.iterdir() if file.suffix.lower() in _PHOTOS and file.is_file())


@cache
def _read_suffixes() -> frozenset[str]:
    """Endings of files that Pillow reads here."""
    with suppress(ImportError):
        import pillow_heif

        pillow_heif.register_heif_opener()
    return frozenset(suffix for suffix, kind in Image.registered_extensions().items() if kind in Image.OPEN)


def upright_photos(files: Sequence[Path], folder: Path) -> list[Path]:
    """Each photo as a JPEG or PNG whose rows are those one sees: the file itself, or else a PNG in `folder`.

    Raises:
        InvalidInput: ``input-image``.
        OSError: a photo cannot be read, or the disk is full.
    """
    folder.mkdir()

    def upright(number: int, file: Path) -> Path:
        with open_image(file) as image:
            if image.format in _PLAIN and image.getexif().get(ExifTags.Base.Orientation, 1) == 1:
                return file
            made = folder / f"{number}.png"
            turned = ImageOps.exif_transpose(image)
            turned.convert("RGBA" if turned.has_transparency_data else "RGB").save(made, compress_level=1)
        return made

    with ThreadPoolExecutor() as pool:
        return list(pool.map(upright, range(len(files)), files))


def size_of(file: Path) -> tuple[int, int]:
    """Width and height of a picture, pixels.

    Raises:
        InvalidInput: ``input-image``.
        OSError: it cannot be read.
    """
    with open_image(file) as image:
        return image.size


def black(files: Sequence[Path]) -> list[bool]:
    """Whether each picture is entirely black. Every picture is read to its end, so that a truncated one is found.

    Raises:
        InvalidInput: ``input-image``.
        OSError: a file cannot be read.
    """
    with ThreadPoolExecutor() as pool:
        return list(pool.map(lambda file: bool(read_pixels(file).max() <= _BLACK), files))


def list_names(names: Sequence[str]) -> str:
    """The first of some names, and how many more there are."""
    more = len(names) - _SHOWN_NAMES
    return ", ".join(names[:_SHOWN_NAMES]) + (f" and {more} more" if more > 0 else "")


def _folders(path: Path) -> list[Path]:
    """The folders that may hold photos, most likely first. COLMAP's models lie below the folder that holds
    `images/`."""
    base = path if path.is_dir() else path.parent
    above = [base] if listings(path)[0].suffix == ".json" else [base, *base.absolute().parents[:2]]
    return [folder for parent in above for folder in (parent / "images", parent)]


def _picture(folders: Sequence[Path], name: str) -> Path | None:
    if "\0" in name:
        return None
    return next((file for folder in folders if (file := picture_file(folder, name)) is not None), None)


def _check_size(path: Path, view: View, file: Path) -> None:
    width, height = size_of(file)
    if (width, height) != (view.width, view.height):
        message = (
            f"{file.name} has {width}x{height} pixels, but its camera {view.width}x{view.height}; give the photos the"
            " poses were made from, or scale the cameras too"
        )
        raise wrong_capture(path, message)
