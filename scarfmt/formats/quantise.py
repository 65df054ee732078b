"""Conversions that several quantised splat formats share, in both directions."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F32, F64, I64, U8, U32

FLAT_LOG_SCALE = math.log(1e-9)
"""Log scale of an axis without extent, such as the missing third one of a 2D Gaussian."""


def opacities(logits: F32) -> F64:
    """(N,) float64 opacities 0..1 of (N,) logits of any size."""
    return np.asarray(np.exp(-np.logaddexp(0.0, -logits.astype(np.float64))))


def alpha_of_logit(logits: F32) -> U8:
    """(N,) uint8 opacities, 255 opaque, of (N,) logits."""
    return np.rint(opacities(logits) * 255).astype(np.uint8)


def unit_quaternions(quaternions: F32) -> F64:
    """(N, 4) float64 of length 1; a zero quaternion becomes the identity, as renderers take it."""
    q = quaternions.astype(np.float64)
    largest = np.abs(q).max(axis=1, keepdims=True, initial=0)
    # Divided by the largest first, so that no square over- or underflows.
    q = np.where(largest > 0, q / np.where(largest > 0, largest, 1.0), np.array([1.0, 0, 0, 0]))
    return np.asarray(q / np.linalg.norm(q, axis=1, keepdims=True))


def smallest_three(quaternions: F64) -> tuple[F64, I64]:
    """Unit quaternions without their component of largest magnitude, which is made positive.

    Args:
        quaternions: (N, 4) float64 of length 1, components in the order of the format.

    Returns:
        (N, 3) float64, the other components in their order, each within +-sqrt(1/2); (N,) position of the missing one.
    """
    rows = np.arange(len(quaternions))
    omitted = np.abs(quaternions).argmax(axis=1)
    signed = quaternions * np.where(quaternions[rows, omitted] < 0, -1.0, 1.0)[:, None]
    keep = np.array([[j for j in range(4) if j != i] for i in range(4)])[omitted]
    return signed[rows[:, None], keep], omitted


def levels(fractions: NDArray[np.floating], count: int) -> U32:
    """The nearest of `count` equal steps from 0 to 1, as 0..count - 1."""
    nearest: U32 = np.rint(np.clip(fractions, 0.0, 1.0) * (count - 1)).astype(np.uint32)
    return nearest


SH_C0 = 0.28209479177387814
"""Value of the degree 0 spherical harmonic, 1 / (2 sqrt(pi))."""


def logit_of_alpha(alpha: U8) -> F32:
    """Opacity logits of 8-bit opacities.

    0 and 255 stand for the half of their bin inside (0, 1): 0.5/255 and 254.5/255, logits of -6.23 and 6.23,
    so that every byte gives a finite logit and 0 and 255 stay apart from 1 and 254.

    Args:
        alpha: (N,) uint8, 255 is opaque.

    Returns:
        (N,) float32.
    """
    table = np.clip(np.arange(256.0), 0.5, 254.5) / 255.0
    logits: F32 = np.log(table / (1.0 - table)).astype(np.float32)[alpha]
    return logits


def dc_of_colour(colour: F64) -> F32:
    """Degree 0 coefficients (N, 1, 3) float32 of view-independent colours (N, 3), 0 black, 1 white."""
    return ((colour - 0.5) / SH_C0).astype(np.float32)[:, None, :]


def complete_smallest_three(kept: F64, omitted: NDArray[np.integer]) -> F64:
    """Unit quaternions of which the component of largest magnitude was left out, and is not negative.

    Args:
        kept: (N, 3) float64, the other components in their order.
        omitted: (N,) integer 0..3, position of the missing component.

    Returns:
        (N, 4) float64, components in the order of the format.
    """
    largest = np.sqrt(np.maximum(0.0, 1.0 - (kept**2).sum(1)))
    kept_positions = np.array([[j for j in range(4) if j != i] for i in range(4)])[omitted]
    quaternions = np.empty((len(kept), 4))
    rows = np.arange(len(kept))
    quaternions[rows, omitted] = largest
    quaternions[rows[:, None], kept_positions] = kept
    return quaternions


def sh_from_channel_major(dc: NDArray[np.generic], rest: NDArray[np.generic]) -> F32:
    """(N, 1 + R, 3) float32: (N, 3) of degree 0, then INRIA's f_rest columns (N, 3 R), all of red first."""
    count, columns = rest.shape
    sh = np.empty((count, 1 + columns // 3, 3), np.float32)
    sh[:, 0], sh[:, 1:] = dc, rest.reshape(count, 3, columns // 3).transpose(0, 2, 1)
    return sh


_HALF_TINIEST = 2.0**-150
"""Half the least number of float32 above 0. It stands for a scale of 0, which has no logarithm."""

_OPACITY_ENDS = {
    "f4": (_HALF_TINIEST, 2.0**-25),
    "f2": (2.0**-25, 2.0**-12),
    "u2": (0.5 / 65535, 0.5 / 65535),
    "u1": (0.5 / 255, 0.5 / 255),
}
"""Half the steps of opacity next to 0 and to 1."""


def log_scale(scales: NDArray[np.floating]) -> F32:
    """Logarithms of standard deviations of at least 0."""
    return np.log(np.maximum(scales.astype(np.float64), _HALF_TINIEST)).astype(np.float32)


def logit_of_opacity(opacity: NDArray[np.floating], stored: str) -> F32:
    """(N,) logits of (N,) opacities 0..1.

    Args:
        opacity: 0 and 1, which have no logits, are read as half a step more and less.
        stored: NumPy's name of the type that they are stored in: f4, f2, u2 or u1.
    """
    low, high = _OPACITY_ENDS[stored]
    values = np.clip(opacity.astype(np.float64), low, 1 - high)
    return (np.log(values) - np.log1p(-values)).astype(np.float32)
