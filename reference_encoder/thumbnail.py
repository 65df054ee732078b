"""The THUMBNAIL of a file: a small WebP picture of its opening view (SPEC §7.15; encoder only, informative)."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence

from reference_encoder.tuning import (
    THUMBNAIL_LEAST,
    THUMBNAIL_MOST,
    THUMBNAIL_PART,
    THUMBNAIL_QUALITIES,
    THUMBNAIL_WIDTHS,
)
from scarfmt.arrays import F32
from scarfmt.container.file import Block
from scarfmt.container.schema import BlockKind
from scarfmt.render.camera import Camera


def thumbnail_blocks(view: Callable[[Camera], F32], camera: Camera, blocks: Sequence[Block]) -> list[Block]:
    """The block of a file, or none: a small file has no room for one, and without Pillow there is none.

    Args:
        view: draws what a decoder makes of the file.
        camera: the opening view.
        blocks: all others of the file.
    """
    most = min(int(THUMBNAIL_PART * sum(len(block.payload) for block in blocks)), THUMBNAIL_MOST)
    picture = draw_thumbnail(view, camera, most) if most >= THUMBNAIL_LEAST else None
    return [] if picture is None else [Block(BlockKind.THUMBNAIL, 1, picture)]


def draw_thumbnail(view: Callable[[Camera], F32], camera: Camera, most: int) -> bytes | None:
    """A WebP file of at most `most` bytes, the widest that still looks good; None if none is as small."""
    try:
        from PIL import Image, features

        from scarfmt.render.images import to_bytes
    except ImportError:
        return None
    if not features.check("webp"):
        return None
    for width in THUMBNAIL_WIDTHS:
        image = Image.fromarray(to_bytes(view(camera.scaled(width / camera.width))))
        for quality in THUMBNAIL_QUALITIES:
            file = io.BytesIO()
            image.save(file, "WEBP", quality=quality, method=6)
            if file.tell() <= most:
                return file.getvalue()
    return None
