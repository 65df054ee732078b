"""Pictures on disk: in and out, and contact sheets."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, UnidentifiedImageError

from scarfmt.arrays import F32, U8
from scarfmt.atomic import atomic_write, note_read
from scarfmt.errors import InvalidInput

_LABEL_HEIGHT = 18
_LABEL_INK = (230, 230, 230)


def to_bytes(image: NDArray[np.floating]) -> NDArray[np.uint8]:
    """(height, width, 3) uint8 of a picture of floats: clipped to [0, 1] and rounded to nearest; NaN becomes 0."""
    scaled = np.clip(np.nan_to_num(image), 0.0, 1.0) * 255 + 0.5
    return np.asarray(scaled, dtype=np.uint8)


def write_png(path: str | Path, image: NDArray[np.floating]) -> None:
    """Write a (height, width, 3) picture of floats as an 8-bit PNG, over a file of that name; never half a file.

    Raises:
        InvalidInput: ``output-path`` when the file cannot be written.
    """
    with atomic_write(path, force=True) as stream:
        Image.fromarray(to_bytes(image)).save(stream, format="PNG")


def convert_picture(data: bytes, suffix: str) -> bytes:
    """A picture file in the format that a name's ending, as ``.jpg``, says: PNG where it says none.

    Raises:
        InvalidInput: ``input-image``: it is no picture pillow can read.
    """
    out, formats = io.BytesIO(), Image.registered_extensions()
    try:
        with Image.open(io.BytesIO(data)) as image:
            image.save(out, formats.get(suffix.lower(), "PNG"))
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise InvalidInput("input-image", f"no readable picture ({error}): a name in .webp takes any") from error
    return out.getvalue()


def read_image(path: str | Path) -> F32:
    """A picture file as (height, width, 3) float32 in [0, 1]; see :func:`read_pixels`."""
    return read_pixels(path).astype(np.float32) / np.float32(255)


def read_pixels(path: str | Path) -> U8:
    """A picture file as (height, width, 3) uint8, rows as stored: EXIF's orientation is not applied, as in COLMAP.

    What is transparent shows black, which is what is behind a scene when it is drawn.

    Raises:
        InvalidInput: ``input-image``: as :func:`opened_image`.
        OSError: the file cannot be opened.
    """
    with open_image(path) as image:
        if not image.has_transparency_data:
            return np.asarray(image.convert("RGB"))
        pixels = np.asarray(image.convert("RGBA"), dtype=np.uint32)
    return ((pixels[..., :3] * pixels[..., 3:] + 127) // 255).astype(np.uint8)


@contextmanager
def open_image(path: str | Path) -> Iterator[Image.Image]:
    """A picture file, its header read, and its pixels when they are asked for within.

    Raises:
        InvalidInput: ``input-image``: it is no picture pillow can read, is cut short, or has over 8 bits a channel.
        OSError: the file cannot be opened.
    """
    try:
        if not Path(path).is_file() and Path(path).exists():
            raise InvalidInput("input-image", f"{path} is not a regular file: give a PNG or JPEG file")
        with Image.open(path) as image:
            note_read(path)
            if image.mode.startswith(("I", "F")):
                raise InvalidInput("input-image", f"{path} has more than 8 bits a channel: convert it to 8")
            yield image
    except InvalidInput:  # a ValueError too, as of a name that no file can have
        raise
    except (UnidentifiedImageError, Image.DecompressionBombError, SyntaxError, ValueError) as error:
        raise InvalidInput("input-image", f"{path} is not a readable picture: give a PNG or JPEG file") from error
    except OSError as error:
        if error.errno is not None:  # else pillow's own, of what the file holds
            raise
        raise InvalidInput("input-image", f"{path} is damaged ({error}): copy it again") from error


def contact_sheet(images: Sequence[NDArray[np.floating]], labels: Sequence[str] = (), columns: int = 4) -> F32:
    """One picture, (H, W, 3) float32, of many of one size: row by row, each with its label under it.

    Args:
        images: (height, width, 3) floats, all of one shape.
        labels: one per image, or none at all, which leaves no room for labels.

    Raises:
        InvalidInput: no images, different sizes, or another number of labels.
    """
    if not images or any(image.shape != images[0].shape for image in images):
        raise InvalidInput("input-shape", "a contact sheet needs at least one picture, and all of one size")
    if labels and len(labels) != len(images):
        raise InvalidInput("input-shape", f"{len(labels)} labels for {len(images)} pictures: give one each, or none")
    height, width = images[0].shape[:2]
    columns = min(columns, len(images))
    step = height + (_LABEL_HEIGHT if labels else 0)
    sheet = Image.new("RGB", (columns * width, -(-len(images) // columns) * step))
    draw = ImageDraw.Draw(sheet)
    for k, image in enumerate(images):
        left, top = k % columns * width, k // columns * step
        sheet.paste(Image.fromarray(to_bytes(image)), (left, top))
        if labels:
            draw.text((left + 4, top + height + 3), labels[k], fill=_LABEL_INK)
    return np.asarray(sheet, dtype=np.float32) / np.float32(255)
