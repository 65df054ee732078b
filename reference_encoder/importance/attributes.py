"""The explicit profile's attributes of a Gaussian scene, before quantisation (SPEC §9; encoder side).

Only what a renderer can see is kept: axes sorted by scale, orientation as normal and twist, opacity as a
logarithm, colour decorrelated. Every map here is undone by the formulas of SPEC §9.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from reference_encoder.tuning import BLUR_PX2, HIDDEN_SCALE
from scarfmt.arrays import F64
from scarfmt.container.schema import RenderModel
from scarfmt.scene.activation import colour_from_spherical_harmonics, log_opacities
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.scene.rotation import normal_and_twist, sort_axes

MIN_LOG_OPACITY = -7.0
"""Opacity 0.0009; a renderer skips everything below 1/255."""
MIN_LOG_SCALE, MAX_LOG_SCALE = -46.0, 40.0
"""Scales of 1e-20 survive; a log scale outside binary32's exponent range does not."""


@dataclass(frozen=True)
class Attributes:
    """N Gaussians in the terms of SPEC §9.

    Attributes:
        positions: (N, 3) float64.
        log_scales: (N, 3) float64, descending.
        rotation: (N, 3) float64: normal square u, v and twist.
        log_opacity: (N, 1) float64.
        colour: (N, 3) float64: Y, G, O of the degree-0 coefficients.
        rest: (N, 3 * ((degree + 1)^2 - 1)) float32, coefficient-major.
    """

    positions: F64
    log_scales: F64
    rotation: F64
    log_opacity: F64
    colour: F64
    rest: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def sh_degree(self) -> int:
        """Degree of the spherical harmonics, 0..3."""
        return math.isqrt(self.rest.shape[1] // 3 + 1) - 1


def from_scene(scene: GaussianScene) -> Attributes:
    """Attributes of a scene without NaN or infinity."""
    log_scales, axes = sort_axes(np.clip(scene.log_scales, MIN_LOG_SCALE, MAX_LOG_SCALE), scene.rotations)
    square, twist = normal_and_twist(axes)
    log_opacity = np.maximum(log_opacities(scene.opacity_logits), MIN_LOG_OPACITY)
    return Attributes(
        scene.positions,
        log_scales,
        np.concatenate([square, twist[:, None]], axis=1),
        log_opacity[:, None],
        colour_from_spherical_harmonics(scene.sh[:, 0]),
        scene.sh.reshape(len(scene), -1)[:, 3:],
    )


def visible_attributes(scene: GaussianScene, pixel: NDArray[np.floating]) -> Attributes:
    """Attributes of a scene without NaN or infinity, axes that are hidden in the blur of a pixel as long as they may be
    without being seen.

    Nobody sees how thin a flat splat is. What its shortest axis says costs bits all the same, and most where flat means
    anything from a thousandth of a pixel down. But antialiasing makes Gaussians fainter by how thin they are.

    Args:
        pixel: (N,) width of a pixel at each Gaussian, world units.
    """
    attributes = from_scene(scene)
    if scene.description.render_model == RenderModel.ANTIALIASED:
        return attributes
    hidden = HIDDEN_SCALE * np.sqrt(BLUR_PX2) * np.maximum(pixel.astype(np.float64), np.exp(MIN_LOG_SCALE))
    least = np.minimum(np.log(hidden), MAX_LOG_SCALE)
    return replace(attributes, log_scales=np.maximum(attributes.log_scales, least[:, None]))
