"""The small picture at the front of a file."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from reference_encoder.opening_view import draw_thumbnail, thumbnail_blocks
from scarfmt.arrays import F32
from scarfmt.container.schema import BlockKind
from scarfmt.render.camera import Camera, look_at

CAMERA = look_at(np.array([0.0, 0, -3]), np.zeros(3), np.array([0.0, -1, 0]), 640, 480)


def _waves(camera: Camera) -> F32:
    """A picture with some detail in it."""
    y, x = np.mgrid[: camera.height, : camera.width] * (5 / camera.width)
    return np.stack([0.5 + 0.5 * np.sin(x + k) * np.cos(y * (1 + k)) for k in range(3)], axis=2).astype(np.float32)


@pytest.mark.parametrize("most", [700, 1500, 6000])
def test_it_is_as_wide_as_its_bytes_allow(most: int) -> None:
    """A WebP picture of the shape of the view, with at most so many bytes; more bytes, no narrower picture."""
    picture = draw_thumbnail(_waves, CAMERA, most)
    assert len(picture) <= most
    image = Image.open(io.BytesIO(picture))
    assert image.format == "WEBP"
    assert image.width * 3 == image.height * 4
    wider = draw_thumbnail(_waves, CAMERA, 4 * most)
    assert wider is not None
    assert Image.open(io.BytesIO(wider)).width >= image.width


def test_it_takes_a_hundredth_of_a_file_at_most() -> None:
    """Small files have none; large ones no more than 6,000 bytes."""
    assert thumbnail_blocks(_waves, CAMERA, 50_000) == []
    (block,) = thumbnail_blocks(_waves, CAMERA, 150_000)
    assert (block.kind, block.layer) == (BlockKind.THUMBNAIL, 1)
    assert len(block.payload) <= 1500
    assert len(thumbnail_blocks(_waves, CAMERA, 10_000_000)[0].payload) <= 6000
