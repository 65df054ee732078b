"""PSNR and SSIM are the figures the papers report."""

from __future__ import annotations

import math

import numpy as np
import pytest

from scarfmt.render.metrics import psnr, ssim
from tests.samples.codec_samples import refuses


def _pair(seed: int, height: int = 17, width: int = 14) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    a = rng.uniform(0, 1, (height, width, 3))
    return a, np.clip(a + rng.normal(0, 0.2, a.shape), 0, 1)


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
    refuses("input-shape", lambda: metric(np.zeros((4, 5, 3)), np.zeros((5, 4, 3))))
