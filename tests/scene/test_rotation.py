"""Orientation survives as what it means, the covariance, through normal and twist."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scarfmt.arrays import F64
from scarfmt.scene.rotation import (
    matrix_from_quaternion,
    normal_and_twist,
    quaternion_from,
    quaternion_from_matrix,
    sort_axes,
)


def covariance(log_scales: F64, quaternions: F64) -> F64:
    """(N, 3, 3) R diag(s^2) R^T."""
    axes = matrix_from_quaternion(quaternions) * np.exp(log_scales)[:, None, :]
    return axes @ axes.transpose(0, 2, 1)


def relative_error(log_scales: F64, quaternions: F64) -> float:
    """Largest change of the covariance by the detour, in units of its largest entry."""
    before = covariance(log_scales, quaternions)
    sorted_scales, axes = sort_axes(log_scales, quaternions)
    square, twist = normal_and_twist(axes)
    assert np.abs(square).max() <= 1 + 1e-12
    assert float(twist.min()) >= -np.pi / 2
    assert float(twist.max()) <= np.pi / 2
    back = quaternion_from(square, twist)
    assert np.allclose(np.linalg.norm(back, axis=1), 1, atol=1e-12)
    assert bool((back[:, 0] >= 0).all())
    change = np.abs(covariance(sorted_scales, back) - before).max(axis=(1, 2))
    return float((change / np.abs(before).max(axis=(1, 2))).max())


def test_random_ellipsoids_keep_their_covariance() -> None:
    """Any rotation, scales over twelve decades."""
    rng = np.random.default_rng(1)
    assert relative_error(rng.uniform(-14, 14, (20000, 3)), rng.normal(size=(20000, 4))) < 1e-12


def _axis_aligned() -> F64:
    half = np.sqrt(0.5)
    turns = [[1, 0, 0, 0], [half, half, 0, 0], [half, 0, half, 0], [half, 0, 0, half], [0.5, 0.5, 0.5, 0.5]]
    signed = np.array(turns)[:, None, :] * np.array(np.meshgrid(*[[1, -1]] * 4)).reshape(4, -1).T[None]
    rows: F64 = signed.reshape(-1, 4)
    return rows


def _equator(count: int = 400) -> F64:
    """Rotations that lay the z axis into the plane z = 0, exactly and by rounding errors above or below."""
    turn = np.linspace(0, 2 * np.pi, count)
    flat = np.stack([np.cos(turn / 2), np.zeros(count), np.zeros(count), np.sin(turn / 2)], axis=1)
    lay = np.array([np.sqrt(0.5), np.sqrt(0.5), 0, 0])
    w, x, y, z = flat.T
    a, b, _, _ = lay
    return np.stack([w * a - x * b, w * b + x * a, y * a + z * b, z * a - y * b], axis=1)


CASES = {
    "zero quaternion": np.zeros((6, 4)),
    "axis-aligned": _axis_aligned(),
    "normal on the equator": _equator(),
    "normal a hair off the equator": _equator() + np.random.default_rng(2).normal(size=(400, 4)) * 1e-16,
    "tiny": np.random.default_rng(3).normal(size=(50, 4)) * 1e-30,
    "subnormal in binary32": np.random.default_rng(3).normal(size=(50, 4)) * 1e-42,
    "smallest binary64": np.array([[5e-324, 0, 0, 0], [0, 5e-324, 5e-324, 0]]),
    "huge": np.random.default_rng(4).normal(size=(50, 4)) * 1e30,
    "largest binary64": np.array([[1.7e308, 1.7e308, -1.7e308, 1.7e308]]),
    "mixed magnitudes": np.array([[1e30, 1e-30, 1, 0], [1e-30, 0, 0, 1], [0, 1e30, 1e30, 1e-30]]),
}
SCALES = {
    "descending": [-1.0, -2.0, -3.0],
    "mixed order": [-1.0, -3.0, -2.0],
    "two equal": [-2.0, -1.0, -2.0],
    "all equal": [0.5, 0.5, 0.5],
}


@pytest.mark.parametrize("scales", SCALES)
@pytest.mark.parametrize("name", CASES)
def test_degenerate_orientations_keep_their_covariance(name: str, scales: str) -> None:
    """Quaternions of no length or extreme length, equal scales, normals where the hemisphere flips."""
    quaternions = CASES[name]
    assert relative_error(np.tile(SCALES[scales], (len(quaternions), 1)), quaternions) < 1e-12


@given(st.integers(0, 2**32 - 1))
def test_axes_are_sorted_longest_first(seed: int) -> None:
    """Scales descend, and each scale keeps its own axis; equal scales keep their order."""
    rng = np.random.default_rng(seed)
    scales, quaternions = rng.integers(-2, 3, (8, 3)).astype(np.float64), rng.normal(size=(8, 4))
    found, axes = sort_axes(scales, quaternions)
    assert bool((np.diff(found, axis=1) <= 0).all())
    matrices = matrix_from_quaternion(quaternions)
    for row in range(8):
        order = sorted(range(3), key=lambda axis: -scales[row, axis])
        assert np.array_equal(axes[row], matrices[row][:, order])


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_squares_that_would_overflow_are_rotations_too(dtype: type) -> None:
    """A step may be 2^96 (SPEC §6.4): u and v reach 1.7e38, their squares and sums do not fit binary32."""
    top, rng = float(np.float32(1.7e38)), np.random.default_rng(6)
    extreme = np.array([[top, top], [top, -top], [-top, 0], [1e30, -3], [2.5, 1e20]])
    square = np.concatenate([extreme, rng.normal(size=(100, 2)) * 10.0 ** rng.integers(0, 37, (100, 1))]).astype(dtype)
    twist = rng.uniform(-1.5, 1.5, len(square)).astype(dtype)
    with np.errstate(all="raise", under="ignore"):
        q = quaternion_from(square, twist)
    assert q.dtype == dtype
    u, v = square.astype(np.float64).T
    normal = np.stack([(u + v) / 2, (u - v) / 2, 1 - np.maximum(np.abs(u), np.abs(v))], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    np.testing.assert_allclose(matrix_from_quaternion(q)[:, :, 2], normal, atol=1e-6)


def test_quaternions_of_half_turns_are_found() -> None:
    """Where w is 0 a formula that divides by it fails."""
    quaternions = np.concatenate([np.eye(4), _axis_aligned(), np.array([[0, 1, 1, 0], [0, 1, 0, -1], [1e-9, 0, 1, 1]])])
    matrices = matrix_from_quaternion(quaternions)
    assert np.allclose(matrix_from_quaternion(quaternion_from_matrix(matrices)), matrices, atol=1e-12)
