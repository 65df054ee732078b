"""The views that a range is looked at from, and how many each stands for (encoder only; docs/decisions/0044).

A Gaussian's weight is a power mean over views, most of which is told by the few that are near. Views are drawn with a
chance in proportion to the part of it that each tells, and count as many times as they were unlikely: the sum over all
views is expected to be right, and varies much less than that over views drawn evenly.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from reference_encoder.tuning import SURVEY_POWER
from scarfmt.arrays import F64, I64
from scarfmt.render.camera import Camera
from scarfmt.scene.gaussians import GaussianScene

_REACH = 3.0
"""Deviations of a splat that a picture may show."""


def drawn_views(shares: F64, most: int) -> tuple[I64, F64]:
    """At most so many views, spread over all, and how many each stands for.

    Args:
        shares: (V,) parts of the whole that views tell (:func:`told`), in any unit; of 0, none is drawn.
        most: views, at least 1.

    Returns:
        (n,) rising numbers of views, (n,) at least 1.
    """
    chance = np.minimum(shares > 0, 1.0)
    if chance.sum() > most:
        chance = _chances(shares, most)
    # One view for every whole number that the sum of chances passes by.
    passed = np.floor(np.cumsum(chance) + 0.5 + 1e-9)
    chosen = np.flatnonzero(np.diff(passed, prepend=0.0) > 0)
    return chosen, 1 / chance[chosen]


def _chances(shares: F64, most: int) -> F64:
    """(V,) in proportion to shares, none above 1, that add up to `most`; fewer shares than that are 0."""
    sure = np.zeros(len(shares), bool)
    while True:
        rest = np.where(sure, 0.0, shares)
        chance = np.where(sure, 1.0, rest * ((most - sure.sum()) / rest.sum()))
        more = (chance >= 1) & ~sure
        if not more.any():
            return chance
        sure |= more


def told(scene: GaussianScene, cameras: Sequence[Camera]) -> F64:
    """(V,) part of the weights of Gaussians that each of V views tells, were nothing in front of them: their mean.

    Args:
        scene: some of the Gaussians.
        cameras: all views of a kind.
    """
    if not cameras:
        return np.zeros(0)
    shown = np.stack([_shown(scene, camera) for camera in cameras])
    whole = shown.sum(axis=0)
    seen = whole > 0
    return np.asarray((shown[:, seen] / whole[seen]).sum(axis=1) / max(int(seen.sum()), 1))


def _shown(scene: GaussianScene, camera: Camera) -> F64:
    """(n,) what a view adds to the power sums of Gaussians with nothing before them, but for their opacity."""
    pose = camera.world_to_camera
    x, y, depth = (scene.positions @ pose[:3, :3].T + pose[:3, 3]).T
    before = depth > camera.near
    focal = camera.fx / np.where(before, depth, 1.0)
    sides = np.exp(np.clip(np.sort(scene.log_scales, axis=1)[:, 1:].astype(np.float64), -40, 40)) * focal[:, None]
    reach = _REACH * np.sqrt(sides[:, 1] ** 2 + camera.dilation)
    inside = _inside(camera.cx + x * focal, reach, camera.width)
    inside *= _inside(camera.cy + y * focal * (camera.fy / camera.fx), reach, camera.height)
    area = np.pi * (sides.prod(axis=1) + camera.dilation)
    area = np.minimum(area, camera.width * camera.height) * inside
    # Of a splat that is smaller than a pixel, what counts is how often it meets one.
    return np.asarray(np.where(before, area**SURVEY_POWER + area / 2, 0.0))


def _inside(middle: F64, reach: F64, size: int) -> F64:
    """(n,) part of the intervals of so many pixels about their middles that lies within a picture."""
    width = np.minimum(middle + reach, size) - np.maximum(middle - reach, 0)
    return np.asarray(np.clip(width / (2 * reach), 0, 1))
