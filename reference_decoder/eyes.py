"""From where anchors are looked at to be baked, where nobody says from where they were captured.

Their networks know the views they were trained on, and elsewhere say anything. People photograph a subject from all
round, a little from below and more from above, and fill it with anchors more densely than what lies behind it. So
cameras stand 1 to 3 median distances of the anchors from their median, and look about there.
"""

from __future__ import annotations

import math

import numpy as np

from reference_decoder.anchors import gaussians
from scarfmt.render.camera import NEAR, Camera, look_at, upward_axes
from scarfmt.render.upright import upright
from scarfmt.render.viewpoints import even_numbers
from scarfmt.scene.gaussians import AnchorModel

DEFAULT_VIEWS = 64
_NEAREST, _FURTHEST = 1.0, 3.0
_LOWEST = -0.3
"""Sine of the elevation of the lowest eye."""
_AIM = 0.5
"""How far from the middle a view looks at most, median distances."""
_WIDTH, _HEIGHT, _FOV_DEG = 640, 480, 60.0
_NEAR_PART = 0.05
_SEED = 7


def default_views(model: AnchorModel, count: int = DEFAULT_VIEWS) -> list[Camera]:
    """Cameras round a model, the same for the same model.

    Args:
        model: at least one anchor, and all three networks.
        count: of views of 640x480 pixels.

    Raises:
        InvalidInput: ``input-mlp`` when a network is missing.
    """
    middle = np.median(model.anchors, axis=0)
    radius = float(np.median(np.linalg.norm(model.anchors - middle, axis=1))) or 1.0
    axes = upward_axes(upright(gaussians(model, middle).scene).up)
    views = []
    for number, u in enumerate(even_numbers(count, 6, _SEED), 1):
        distance = radius * _NEAREST * (_FURTHEST / _NEAREST) ** float(u[0])
        height = _LOWEST + (1 - _LOWEST) * float(u[1])
        azimuth, level = 2 * math.pi * float(u[2]), math.sqrt(1 - height * height)
        towards = np.array([level * math.cos(azimuth), level * math.sin(azimuth), height]) @ axes
        target = middle + _AIM * radius * (2 * u[3:6] - 1)
        near = min(NEAR, _NEAR_PART * radius)
        eye = middle + distance * towards
        views.append(look_at(eye, target, axes[2], _WIDTH, _HEIGHT, _FOV_DEG, f"baking {number}", near))
    return views
