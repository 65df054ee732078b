"""The pixels of photos in a file without a name, read when looked at: memory does not grow with their number."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from reference_encoder.training.capture import Photo, pixels
from scarfmt.arrays import U8
from scarfmt.render.camera import Camera
from scarfmt.threads import count_threads

_LEAST_HALF = 360
"""Pixels of the longest side of a photo at half its size: what is learnt of smaller ones has to be learnt again."""


@dataclass(frozen=True)
class View:
    """A camera, and what its picture is to look like.

    Attributes:
        camera: of the photo.
        read: gives its (H, W, 3) uint8 pixels, on the processor.
        number: its place among the photos.
    """

    camera: Camera
    read: Callable[[], Tensor]
    number: int = 0

    def photo(self, device: torch.device) -> Tensor:
        """(H, W, 3) uint8 on a device."""
        return self.read().to(device)


def half_size(views: Sequence[View]) -> list[View]:
    """Photos at half their size; none where that would leave too little to see."""
    if max((max(view.camera.width, view.camera.height) for view in views), default=0) < 2 * _LEAST_HALF:
        return []
    return [_halve(view) for view in views]


def _halve(view: View) -> View:
    camera = view.camera.scale(0.5)

    def read() -> Tensor:
        whole = Image.fromarray(view.read().numpy())
        return torch.from_numpy(np.array(whole.resize((camera.width, camera.height), Image.Resampling.BOX)))

    return View(camera, read, view.number)


def store_photos(photos: Sequence[Photo], folder: Path | None) -> list[View]:
    """Photos, each decoded once.

    Args:
        folder: where the file is, which the system removes when the process ends; made if it is not there. None for
            where it keeps temporary files.

    Raises:
        InvalidInput: ``input-image``.
        OSError: a photo cannot be read, or the disk is full.
    """
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
    stream = TemporaryFile(dir=folder)  # noqa: SIM115 - it lives as long as the views
    views: list[View] = []
    for photo, picture in zip(photos, _decode(photos), strict=True):
        views.append(View(photo.camera, _reader(stream, stream.tell(), picture.shape), len(views)))
        stream.write(picture.tobytes())
    return views


def _decode(photos: Sequence[Photo]) -> Iterator[U8]:
    """The pixels of each photo; only as many at once as there are threads."""
    threads = count_threads()
    with ThreadPoolExecutor(threads) as pool:
        for first in range(0, len(photos), threads):
            yield from pool.map(pixels, photos[first : first + threads])


def _reader(stream: IO[bytes], start: int, shape: tuple[int, ...]) -> Callable[[], Tensor]:
    def read() -> Tensor:
        stream.seek(start)
        picture = np.frombuffer(bytearray(stream.read(math.prod(shape))), np.uint8).reshape(shape)
        return torch.from_numpy(picture)

    return read
