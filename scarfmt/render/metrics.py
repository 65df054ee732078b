"""Picture quality: PSNR and SSIM as the 3D Gaussian Splatting papers compute them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F64
from scarfmt.errors import InvalidInput

_RADIUS, _SIGMA = 5, 1.5
_C1, _C2 = 0.01**2, 0.03**2


def psnr(a: NDArray[np.floating], b: NDArray[np.floating]) -> float:
    """Peak signal-to-noise ratio of two pictures, dB, peak 1, both clipped to [0, 1]; `math.inf` if they are equal.

    Args:
        a, b: pictures of one shape, (height, width, 3) floats.

    Raises:
        InvalidInput: the shapes differ.
    """
    _check_shapes(a, b)
    error = float(np.mean((_clip(a) - _clip(b)) ** 2))
    return math.inf if error == 0 else -10 * math.log10(error)


def ssim(a: NDArray[np.floating], b: NDArray[np.floating]) -> float:
    """Structural similarity of two pictures clipped to [0, 1]: 1 if they are equal, can be negative.

    Wang et al. 2004 with an 11x11 Gaussian window of sigma 1.5, zeros beyond the border and the mean over all
    pixels and channels: the figure of the 3DGS papers. Other libraries treat the border in another way.

    Args:
        a, b: pictures of one shape, (height, width, 3) floats.

    Raises:
        InvalidInput: the shapes differ.
    """
    _check_shapes(a, b)
    a, b = _clip(a), _clip(b)
    mean_a, mean_b = _window_mean(a), _window_mean(b)
    variance_a = _window_mean(a * a) - mean_a**2
    variance_b = _window_mean(b * b) - mean_b**2
    covariance = _window_mean(a * b) - mean_a * mean_b
    luminance = (2 * mean_a * mean_b + _C1) / (mean_a**2 + mean_b**2 + _C1)
    structure = (2 * covariance + _C2) / (variance_a + variance_b + _C2)
    return float(np.mean(luminance * structure))


def _window_mean(image: F64) -> F64:
    """Means over the window, which is a product of one along the rows and one along the columns."""
    return _mean_along(_mean_along(image, 0), 1)


def _mean_along(image: F64, axis: int) -> F64:
    """Weighted means along one axis, zeros beyond the border; neighbours at like distance share a weight."""
    weights = np.exp(-(np.arange(_RADIUS + 1) ** 2) / (2 * _SIGMA**2))
    weights /= weights[0] + 2 * weights[1:].sum()
    lines = np.moveaxis(image, axis, 0)
    means = weights[0] * lines
    for distance in range(1, min(_RADIUS, len(lines) - 1) + 1):
        means[distance:] += weights[distance] * lines[:-distance]
        means[:-distance] += weights[distance] * lines[distance:]
    return np.moveaxis(means, 0, axis)


def _clip(image: NDArray[np.floating]) -> F64:
    return np.clip(image.astype(np.float64), 0.0, 1.0)


def _check_shapes(a: NDArray[np.floating], b: NDArray[np.floating]) -> None:
    if a.shape != b.shape or a.ndim != 3:
        raise InvalidInput("input-shape", f"expected two pictures of one size, got {a.shape} and {b.shape}")
