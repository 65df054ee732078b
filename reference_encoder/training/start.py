"""Points to start from where a capture has none: drawn at random where its cameras look."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scarfmt.arrays import F64
from scarfmt.render.camera import Camera
from scarfmt.render.capture.points import Points
from scarfmt.render.capture.seen import in_view

DRAWN = 20_000
_CANDIDATES = 8 * DRAWN
_SEEN_BY = 1 / 3
"""Least share of the cameras that must see a point of the start: the photos do not show what fewer cameras see."""
_GREY = 128
_RIDGE = 1e-3
"""Share of the number of cameras that keeps the focus near the eyes if all of them look the same way."""


def drawn_points(cameras: Sequence[Camera]) -> Points:
    """Up to 20,000 grey points, uniform in the part of a ball that a third of the cameras have in their pictures.

    The ball is round the place nearest to all optical axes, and reaches as far as the cameras are from it.

    Args:
        cameras: at least one. The same cameras give the same points.
    """
    eyes = np.array([camera.centre for camera in cameras])
    forward = np.array([camera.world_to_camera[2, :3] for camera in cameras])
    focus = _focus(eyes, forward)
    radius = float(np.median(np.linalg.norm(eyes - focus, axis=1))) or 1.0
    random = np.random.default_rng(0)
    directions = random.normal(size=(_CANDIDATES, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    candidates = focus + radius * np.cbrt(random.random((_CANDIDATES, 1))) * directions
    seen = np.mean([in_view(candidates, camera) for camera in cameras], axis=0)
    enough = seen >= min(_SEEN_BY, float(seen.max()))
    chosen = candidates[enough][:DRAWN]
    return Points(chosen, np.full((len(chosen), 3), _GREY, np.uint8))


def _focus(eyes: F64, forward: F64) -> F64:
    """(3,) float64: the place with the least sum of squared distances to all optical axes.

    Where the axes are about parallel it is in front of the cameras, as far as they are spread.
    """
    across = np.eye(3) - forward[:, :, None] * forward[:, None, :]
    spread = float(np.linalg.norm(eyes - eyes.mean(axis=0), axis=1).max()) or 1.0
    guess = (eyes + spread * forward).mean(axis=0)
    ridge = _RIDGE * len(eyes) * np.eye(3)
    wanted = (across @ eyes[:, :, None])[..., 0].sum(axis=0) + ridge @ guess
    found: F64 = np.linalg.solve(across.sum(axis=0) + ridge, wanted)
    return found
