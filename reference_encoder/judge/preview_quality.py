"""How good a coarse layer looks: by views from everywhere, by its colours and by its worst regions (encoder side).

A mean squared error forgives what an eye does not: a hole in a wall, or a meadow that has lost its green
(docs/decisions/0026-first-layers.md).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from reference_encoder.options import EncodeOptions
from reference_encoder.tuning import LAYER_BLOCK, LAYER_VIEW_SAMPLING, LAYER_VIEWS
from scarfmt.arrays import F32, F64
from scarfmt.render.camera import Camera
from scarfmt.render.projection import Drawable
from scarfmt.render.rasterise import render
from scarfmt.render.threads import each_view
from scarfmt.render.viewpoints import KINDS, WIDTH, Surroundings, viewpoints
from scarfmt.scene.gaussians import GaussianScene

_LEAST_ERROR = 1e-10


@dataclass(frozen=True)
class PreviewJudge:
    """Small pictures of the source from everywhere.

    Attributes:
        cameras: the views, as many of each kind.
        pictures: (height, width, 3) float32 of the source, one a view.
    """

    cameras: Sequence[Camera]
    pictures: Sequence[F32]

    @classmethod
    def of(cls, scene: GaussianScene, options: EncodeOptions) -> PreviewJudge:
        """For `scene`, from everywhere with its up axis; of cameras that are a fence, from some of those."""
        cameras = _fence(options) or _everywhere(scene, options)
        return cls(cameras, list(each_view(partial(render, Drawable.of(scene)), cameras)))

    def psnr_db(self, scene: GaussianScene, most: float) -> float:
        """Mean over the views of how good `scene` looks, dB, each counting as at most `most` dB."""
        drawn = each_view(partial(render, Drawable.of(scene)), self.cameras)
        errors = (preview_error(picture, truth) for picture, truth in zip(drawn, self.pictures, strict=True))
        return float(np.mean([min(-10 * math.log10(max(error, _LEAST_ERROR)), most) for error in errors]))


def _everywhere(scene: GaussianScene, options: EncodeOptions) -> list[Camera]:
    around = Surroundings.of(scene, options.frame)
    views = (view for kind in KINDS for view in viewpoints(around, kind, LAYER_VIEWS, options.seed))
    return [view.sampled(LAYER_VIEW_SAMPLING) for view in views]


def _fence(options: EncodeOptions) -> list[Camera]:
    """Some of the cameras that nobody will leave, evenly spread; none where there is no such fence."""
    if not options.only_cameras or not options.cameras:
        return []
    every = max(1, -(-len(options.cameras) // (len(KINDS) * LAYER_VIEWS)))
    wide = WIDTH / LAYER_VIEW_SAMPLING
    return [camera.sampled(max(1, round(camera.width / wide))) for camera in options.cameras[::every]]


def preview_error(picture: F32, truth: F32) -> float:
    """Half the mean squared error, and half that of the mean colours of blocks, in which the worst count most.

    An even error of colour counts as in the PSNR, fine noise as little as half of it, and holes more.

    Args:
        picture, truth: (height, width, 3).
    """
    difference = np.clip(picture, 0, 1).astype(np.float64) - np.clip(truth, 0, 1)
    coarse = (_blocks(difference) ** 2).mean(axis=2)
    return float(0.5 * (difference**2).mean() + 0.5 * math.sqrt((coarse**2).mean()))


def _blocks(picture: F64) -> F64:
    """(rows, columns, 3) means of whole blocks; of the picture itself where there is no whole one."""
    side = min(LAYER_BLOCK, *picture.shape[:2])
    rows, columns = picture.shape[0] // side, picture.shape[1] // side
    tiles = picture[: rows * side, : columns * side].reshape(rows, side, columns, side, 3)
    return np.asarray(tiles.mean(axis=(1, 3)))
