"""The view that a file opens with, and its THUMBNAIL, a small WebP picture of it (SPEC §7.15; encoder only,
informative).

Of given cameras the one amid most of them. Else the view, of some from outside, from near and from the middle, whose
picture has the most detail and the least fog before it; a subject that stands by itself then fills the frame.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from reference_encoder.importance.view_sampling import given_cameras
from reference_encoder.options import EncodeOptions
from reference_encoder.streaming_block import place_anchors
from reference_encoder.tuning import (
    DETAIL_BLOCK,
    OPENING_ALONE,
    OPENING_FILLED,
    OPENING_FOG,
    OPENING_FRAMED,
    OPENING_GAUSSIANS,
    OPENING_LOOK_FACTOR,
    OPENING_LOOKS,
    OPENING_NEIGHBOURS,
    OPENING_RINGS,
    OPENING_SAMPLING,
    OPENING_TURNS,
    OPENING_WIDE,
    THUMBNAIL_LEAST,
    THUMBNAIL_MOST,
    THUMBNAIL_PART,
    THUMBNAIL_QUALITIES,
    THUMBNAIL_WIDTHS,
)
from scarfmt.arrays import F32, F64
from scarfmt.container.file import Block
from scarfmt.container.schema import BlockKind
from scarfmt.render.camera import Camera
from scarfmt.render.projection import Drawable
from scarfmt.render.rasterise import render_with
from scarfmt.render.viewpoints import Surroundings
from scarfmt.scene.gaussians import AnchorModel, GaussianScene


def find_opening_view(scene: GaussianScene | AnchorModel, options: EncodeOptions) -> Camera:
    """The view to begin with; of an anchor model without cameras, one from outside and a little above.

    Args:
        scene: what a decoder makes of a file.
        options: `cameras` and `frame` of the encoder.

    Raises:
        InvalidInput: ``input-frame``.
    """
    if options.cameras:
        return middle_camera(given_cameras(options))
    around = Surroundings.of(place_anchors(scene), options.frame)
    if isinstance(scene, AnchorModel):
        return _look_at(around, around.middle, around.direction(0.5, 20.0), 1.6).camera
    covering, views = scene, list(_views(around))
    if len(scene) > OPENING_GAUSSIANS:
        # Those that cover most: area of the two longest axes times opacity.
        extent = np.sort(scene.log_scales, axis=1)[:, 1:].sum(axis=1) - np.logaddexp(0, -scene.opacity_logits)
        covering = scene.take(np.sort(np.argpartition(-extent, OPENING_GAUSSIANS)[:OPENING_GAUSSIANS]))
    drawable = Drawable.of(covering)
    shown = [_show(drawable, view) for view in views]
    best, _ = max(zip(views, shown, strict=True), key=lambda pair: pair[0].factor * pair[1][0])
    edge = float(np.median([_edge(opacity) for _, opacity in shown[:OPENING_TURNS]]))
    return (_fit_view(drawable, around, best) if best.outside and edge < OPENING_FRAMED else None) or best.camera


@dataclass(frozen=True)
class _View:
    """A view that may be chosen.

    Attributes:
        camera: the whole picture's.
        direction: (3,) from what it looks at to the eye.
        fog: depth below which what is seen is fog, world units.
        factor: of its score.
        outside: whether it looks at the middle.
    """

    camera: Camera
    direction: F64
    fog: float
    factor: float
    outside: bool


def _show(drawable: Drawable, view: _View) -> tuple[float, F32]:
    """What a small picture of a view shows: its detail, less where fog is, and its (height, width) opacity."""
    camera, positions = view.camera.sample(OPENING_SAMPLING), drawable.scene.positions
    depth = (positions - camera.centre) @ camera.world_to_camera[2, :3]
    # Two more channels: how much of it is fog, and how opaque it is.
    shares = np.stack([depth < view.fog, np.ones(len(depth)), np.zeros(len(depth))], axis=1)
    picture, found = render_with(drawable, camera, shares)
    # Mean length of the gradient of a picture of blocks: eyes and edges tell more than fur.
    rows, columns = (size // DETAIL_BLOCK for size in picture.shape[:2])
    whole = np.clip(picture[: rows * DETAIL_BLOCK, : columns * DETAIL_BLOCK], 0, 1)
    shown = whole.reshape(rows, DETAIL_BLOCK, columns, DETAIL_BLOCK, 3).mean(axis=(1, 3))
    down, right = np.diff(shown, axis=0)[:, :-1], np.diff(shown, axis=1)[:-1]
    detail = float(np.sqrt(down**2 + right**2).mean())
    return detail * (1 - float(found[:, :, 0].mean())) ** 2, found[:, :, 1]


def _edge(opacity: F32) -> float:
    """Mean opacity along the edge of the frame."""
    return float(np.concatenate([opacity[[0, -1]].ravel(), opacity[:, [0, -1]].ravel()]).mean())


def _views(around: Surroundings) -> Iterator[_View]:
    for radii, elevation, factor in OPENING_RINGS:
        for turn in (np.arange(OPENING_TURNS) + 0.5) / OPENING_TURNS:
            yield _look_at(around, around.middle, around.direction(float(turn), elevation), radii, factor)
    for turn in (np.arange(OPENING_LOOKS) + 0.5) / OPENING_LOOKS:
        away = around.direction(float(turn), -5.0)
        eye = around.middle - 0.3 * around.radius * away
        camera = around.camera(eye, around.middle + around.radius * away, "opening")
        yield _View(camera, -away, OPENING_FOG / 2 * around.radius, OPENING_LOOK_FACTOR, outside=False)


def _look_at(around: Surroundings, target: F64, direction: F64, radii: float, factor: float = 1.0) -> _View:
    distance = radii * around.radius
    camera = around.camera(target + distance * direction, target, "opening")
    return _View(camera, direction, OPENING_FOG * distance, factor, outside=True)


def _fit_view(drawable: Drawable, around: Surroundings, view: _View) -> Camera | None:
    """The view from the same side in which the subject fills the frame; None where it does not stand by itself."""
    wide = _look_at(around, around.middle, view.direction, OPENING_WIDE)
    _, opacity = _show(drawable, wide)
    if _edge(opacity) >= OPENING_ALONE or not opacity.any():
        return None
    camera, (height, width) = wide.camera.sample(OPENING_SAMPLING), opacity.shape
    # Places between which all but a hundredth of the opacity at either end lies, pixels.
    totals = [np.cumsum(opacity.sum(axis=axis)) for axis in (0, 1)]
    across, down = (np.interp([0.01, 0.99], each / each[-1], np.arange(len(each)) + 1.0) for each in totals)
    distance = OPENING_WIDE * around.radius
    shift = np.array([across.mean() - width / 2, down.mean() - height / 2]) * distance / camera.fx
    filled = max(float(np.ptp(across)) / width, float(np.ptp(down)) / height)
    target = around.middle + shift @ camera.world_to_camera[:2, :3]
    return _look_at(around, target, view.direction, OPENING_WIDE * filled / OPENING_FILLED).camera


def middle_camera(cameras: Sequence[Camera]) -> Camera:
    """The camera from which the nearest eighth of all is least far."""
    centres = np.array([camera.centre for camera in cameras])
    # Each is its own nearest; of few cameras, the next one counts.
    nearest = min(max(len(cameras) // OPENING_NEIGHBOURS, 1), len(cameras) - 1)
    reached = [np.sort(np.linalg.norm(centres - centre, axis=1))[nearest] for centre in centres]
    return cameras[int(np.argmin(reached))]


def thumbnail_blocks(view: Callable[[Camera], F32], camera: Camera, size: int) -> list[Block]:
    """The block of a file, or none: a small file has no room for one, and without Pillow there is none.

    Args:
        view: draws what a decoder makes of the file.
        size: bytes of all other blocks.
    """
    most = min(int(THUMBNAIL_PART * size), THUMBNAIL_MOST)
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
        image = Image.fromarray(to_bytes(view(camera.scale(width / camera.width))))
        for quality in THUMBNAIL_QUALITIES:
            file = io.BytesIO()
            image.save(file, "WEBP", quality=quality, method=6)
            if file.tell() <= most:
                return file.getvalue()
    return None
