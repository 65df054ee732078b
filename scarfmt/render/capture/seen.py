"""Whether cameras and a scene belong together."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from scarfmt.arrays import F64, Bools
from scarfmt.errors import InputWarning
from scarfmt.render.camera import Camera

SEEN_AT_LEAST = 0.02
"""Share of the Gaussians that half of the cameras must see. Captures have 59 and 98 %; with axes or world turned, 0 to
3 % [0024]."""
_POSITIONS, _CAMERAS = 4096, 1024


def part_in_view(positions: F64, cameras: Sequence[Camera]) -> float:
    """The part, 0..1, of (N, 3) float64 positions that half of the cameras have in their pictures, hidden or not.

    An even sample of positions and cameras is looked at.
    """
    sample = positions[:: max(1, len(positions) // _POSITIONS)]
    chosen = cameras[:: max(1, len(cameras) // _CAMERAS)]
    return float(np.median([_part_in_view(sample, camera) for camera in chosen]))


def warn_of_strangers(positions: F64, cameras: Sequence[Camera]) -> None:
    """Warn where half of the cameras have hardly anything in view: most likely they have another frame or scale.

    Args:
        positions: (N, 3) float64, of Gaussians or anchors.
        cameras: at least one.

    Warns:
        InputWarning: half of them have less than 2 % of the positions in their pictures.
    """
    found = part_in_view(positions, cameras)
    if found < SEEN_AT_LEAST:
        message = (
            f"the cameras do not look at the scene: half of the {len(cameras)} have at most {100 * found:.2g} % of it"
            " in view; are they in the frame and scale that the scene was trained in?"
        )
        warnings.warn(message, InputWarning, stacklevel=3)


def in_view(positions: F64, camera: Camera) -> Bools:
    """(N,) bool: which of (N, 3) float64 positions `camera` has in its picture, hidden or not."""
    seen = positions @ camera.world_to_camera[:3, :3].T + camera.world_to_camera[:3, 3]
    x, y, depth = seen[:, 0], seen[:, 1], seen[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        column, row = camera.fx * x / depth + camera.cx, camera.fy * y / depth + camera.cy
    inside: Bools = (column > 0) & (column < camera.width) & (row > 0) & (row < camera.height) & (depth > camera.near)
    return inside


def _part_in_view(positions: F64, camera: Camera) -> float:
    return float(in_view(positions, camera).mean()) if len(positions) else 0.0
