"""PSNR and SSIM are the figures the papers report."""

from __future__ import annotations

import math

import numpy as np
import pytest

from scarfmt.errors import InvalidInput
from scarfmt.render.metrics import psnr, ssim


def _pair(seed: int, height: int = 17, width: int = 14) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    a = rng.uniform(0, 1, (height, width, 3))
    return a, np.clip(a + rng.normal(0, 0.2, a.shape), 0, 1)


def _literal_ssim(a: np.ndarray, b: np.ndarray) -> float:
    """The formula of Wang et al. 2004, pixel by pixel, with a full 2D window over zero-padded pictures."""
    line = np.array([math.exp(-((k - 5) ** 2) / (2 * 1.5**2)) for k in range(11)])
    window = np.outer(line, line) / line.sum() ** 2
    padded_a, padded_b = (np.pad(image, ((5, 5), (5, 5), (0, 0))) for image in (a, b))
    total = 0.0
    for y in range(a.shape[0]):
        for x in range(a.shape[1]):
            for c in range(3):
                p, q = padded_a[y : y + 11, x : x + 11, c], padded_b[y : y + 11, x : x + 11, c]
                mean_p, mean_q = (window * p).sum(), (window * q).sum()
                var_p = (window * p * p).sum() - mean_p**2
                var_q = (window * q * q).sum() - mean_q**2
                cov = (window * p * q).sum() - mean_p * mean_q
                total += ((2 * mean_p * mean_q + 1e-4) * (2 * cov + 9e-4)) / (
                    (mean_p**2 + mean_q**2 + 1e-4) * (var_p + var_q + 9e-4)
                )
    return total / a.size


def test_ssim_is_the_literal_formula() -> None:
    a, b = _pair(0)
    assert ssim(a, b) == pytest.approx(_literal_ssim(a, b), abs=1e-12)
    assert ssim(a, b) < 0.95
    assert ssim(a, a) == pytest.approx(1)


@pytest.mark.parametrize(
    ("seed", "height", "width", "expected"),
    [
        (0, 17, 14, 0.8651187330729285),
        (1, 3, 40, 0.8937089581098557),
        (2, 1, 1, 0.5247717198245861),
        (3, 5, 6, 0.8923245951956768),
        (4, 480, 640, 0.8230768328564764),
    ],
)
def test_ssim_is_what_it_was_computed_with_scipy(seed: int, height: int, width: int, expected: float) -> None:
    """Values of scipy.ndimage.correlate1d: figures published before stay comparable."""
    assert ssim(*_pair(seed, height, width)) == pytest.approx(expected, abs=1e-12)


def test_ssim_of_float32_pictures_is_that_of_float64() -> None:
    a, b = _pair(1)
    assert ssim(a.astype(np.float32), b.astype(np.float32)) == pytest.approx(ssim(a, b), abs=1e-6)


def test_psnr_of_a_known_error() -> None:
    a = np.full((4, 5, 3), 0.5)
    assert psnr(a, a + 0.1) == pytest.approx(20)
    assert psnr(a, a) == math.inf


def test_values_beyond_white_and_black_count_as_white_and_black() -> None:
    """A display cannot show them, so they must not cost quality."""
    a, b = _pair(2)
    a[0], b[1] = 1.0, 0.0
    wild_a, wild_b = a.copy(), b.copy()
    wild_a[0], wild_b[1] = 7.0, -3.0
    assert psnr(wild_a, wild_b) == psnr(a, b)
    assert ssim(wild_a, wild_b) == ssim(a, b)


@pytest.mark.parametrize("metric", [psnr, ssim])
def test_pictures_of_different_sizes_are_refused(metric) -> None:
    with pytest.raises(InvalidInput, match="input-shape"):
        metric(np.zeros((4, 5, 3)), np.zeros((5, 4, 3)))
