"""Reaching the quality that was asked for: pictures of the result tell how far off the prediction was (encoder only).

The model of errors (docs/decisions/0003) is fitted to scenes that fill the picture. A scene on a black background, or
one with fewer overlaps, comes out several dB better than asked, in more bytes. So lambda is corrected by what pictures
of the result show, until they are close enough or the effort is spent (docs/decisions/0017-quality-loop.md).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from reference_encoder.options import EFFORTS, EncodeOptions
from reference_encoder.tuning import (
    GREATEST_SLOPE,
    JUDGED_SEED,
    LEAST_SLOPE,
    MOST_DOWN_DB,
    MOST_UP_DB,
    TOLERANCE_DB,
)
from scarfmt.arrays import F32
from scarfmt.render.camera import Camera
from scarfmt.render.metrics import psnr
from scarfmt.render.rasterise import render
from scarfmt.render.viewpoints import KINDS, Surroundings, viewpoints
from scarfmt.scene.gaussians import GaussianScene

T = TypeVar("T")


@dataclass(frozen=True)
class Judge:
    """Views of the source.

    Attributes:
        cameras: the views.
        pictures: (height, width, 3) float32 of the source, one a view.
    """

    cameras: Sequence[Camera]
    pictures: Sequence[F32]

    @classmethod
    def of(cls, scene: GaussianScene, options: EncodeOptions) -> Judge:
        """For `scene`, by views that its sensitivities were not measured from where there are others."""
        cameras = judged_cameras(scene, options)
        return cls(cameras, [render(scene, camera) for camera in cameras])

    def fewer(self, views: int) -> Judge:
        """At most so many of the views, evenly spread."""
        every = max(1, -(-len(self.cameras) // views))
        return Judge(self.cameras[::every], self.pictures[::every])

    def psnr_db(self, scene: GaussianScene) -> float:
        """Mean PSNR of the pictures of `scene`, dB; infinite if in some view not a pixel differs."""
        pairs = zip(self.cameras, self.pictures, strict=True)
        return float(np.mean([psnr(render(scene, camera), picture) for camera, picture in pairs]))


def judged_cameras(scene: GaussianScene, options: EncodeOptions) -> list[Camera]:
    """Some views from everywhere that the survey has not, or some of the given cameras."""
    views = EFFORTS[options.effort].judged_views
    if options.cameras is None:
        around = Surroundings.of(scene, options.frame)
        return [camera for kind in KINDS for camera in viewpoints(around, kind, -(-views // len(KINDS)), JUDGED_SEED)]
    others = [camera for camera in options.cameras if camera.split != "test"] or list(options.cameras)
    return others[:: max(1, -(-len(others) // views))]


def calibrated(asked: float, corrections: int, attempt: Callable[[float], T], judged: Callable[[T], float]) -> T:
    """The attempt that is close enough to `asked` dB, or the one after the last correction.

    Args:
        asked: dB.
        corrections: at most so many.
        attempt: quality to predict for, dB -> result.
        judged: result -> dB found.
    """
    aim, found, tried = asked, attempt(asked), []
    for _ in range(corrections):
        tried.append((aim, judged(found)))
        better = next_aim(asked, tried)
        if better is None:
            break
        aim, found = better, attempt(better)
    return found


def next_aim(asked: float, tried: Sequence[tuple[float, float]]) -> float | None:
    """The quality to predict for next, so that pictures have `asked` dB; None when the last try was close enough.

    Args:
        asked: dB.
        tried: (aimed at, found) so far, dB; a line through the last two, or at first a slope of 1, leads on.
    """
    aim, found = tried[-1]
    if not math.isfinite(found) or abs(asked - found) <= TOLERANCE_DB:
        return None
    slope = 1.0
    if len(tried) > 1 and aim != tried[-2][0]:
        slope = (found - tried[-2][1]) / (aim - tried[-2][0])
    slope = min(max(slope, LEAST_SLOPE), GREATEST_SLOPE)
    return min(max(aim + (asked - found) / slope, asked - MOST_DOWN_DB), asked + MOST_UP_DB)
