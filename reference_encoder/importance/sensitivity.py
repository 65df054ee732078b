"""How much an error in each attribute of each Gaussian shows in pictures (encoder only, informative).

For small errors the mean squared error of a picture set is close to a sum over Gaussians and attributes of
sensitivity * error^2. Two weights per Gaussian give all of it: of its colour, and of everything that moves or
reshapes it (:mod:`reference_encoder.importance.weights`). docs/decisions/0003-visibility.md has the measured fit of the
model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from reference_encoder.importance.attributes import Attributes
from reference_encoder.importance.weights import Weights
from reference_encoder.tuning import ASPECT_CAP, BLUR_PX2, GAUSSIAN_ABSENCE, OPACITY_SHARE, SCALE_SHARE
from scarfmt.arrays import F64
from scarfmt.container.schema import Stream

SH_C0 = 0.28209479177387814


@dataclass(frozen=True)
class Sensitivity:
    """Mean squared picture error (peak 1) per squared unit of error in each attribute.

    Attributes:
        channels: stream -> (N, components) float64.
        colour: (N,) float64, per squared unit of any SH coefficient.
        absence: (N,) float64, estimated error of leaving the Gaussian out.
    """

    channels: dict[Stream, F64]
    colour: F64
    absence: F64


def estimate_absence(weights: Weights) -> F64:
    """(N,) error of leaving each Gaussian out."""
    return weights.shape.astype(np.float64) * GAUSSIAN_ABSENCE


def estimate_colour(weights: Weights) -> F64:
    """(N,) error per squared unit of any SH coefficient."""
    return weights.colour.astype(np.float64) * SH_C0**2


def measure_sensitivity(attributes: Attributes, weights: Weights) -> Sensitivity:
    """Sensitivities of N Gaussians, from their weights."""
    shapes, colours = weights.shape.astype(np.float64), estimate_colour(weights)
    variance = np.exp(2 * np.clip(attributes.log_scales, -40, 40))
    blurred = variance + BLUR_PX2 * (weights.pixel.astype(np.float64) ** 2)[:, None]
    visible = variance / blurred

    def aspect(a: int, b: int) -> F64:
        ratio = (blurred[:, a] - blurred[:, b]) ** 2 / (blurred[:, a] * blurred[:, b])
        return np.minimum(ratio, ASPECT_CAP)

    swing, twist = shapes * aspect(0, 2), shapes * aspect(0, 1)
    channels = {
        Stream.POSITION_RESIDUAL: np.repeat((shapes / blurred[:, 1])[:, None], 3, axis=1),
        Stream.SCALE: shapes[:, None] * visible * SCALE_SHARE,
        Stream.ROTATION: np.stack([swing, swing, twist], axis=1),
        Stream.OPACITY: (shapes * OPACITY_SHARE)[:, None],
        # dc = (Y - G + O, Y + G, Y - G - O): squared column norms 3, 3, 2.
        Stream.COLOUR: colours[:, None] * np.array([3.0, 3.0, 2.0]),
    }
    return Sensitivity(channels, colours, estimate_absence(weights))
