"""Gaussians turned, scaled and moved look as before to a camera that goes with them; spherical harmonics turn alike."""

from __future__ import annotations

import numpy as np
import pytest

from scarfmt.scene.gaussians import GaussianScene
from scarfmt.scene.placement import Placement, sh_basis
from scarfmt.scene.rotation import matrix_from_quaternion

RNG = np.random.default_rng(5)
ROTATION = matrix_from_quaternion(RNG.normal(size=(1, 4)))[0]
ROWS = [*np.hstack([2.5 * ROTATION, [[7.0], [-1e4], [0.125]]]).tolist(), [0, 0, 0, 1]]
PLACEMENT = Placement.of(ROWS)


def scene(degree: int = 3) -> GaussianScene:
    draw = [RNG.normal(size=(40, *shape)).astype(np.float32) for shape in ((3,), (4,), (), ((degree + 1) ** 2, 3))]
    return GaussianScene(RNG.normal(size=(40, 3)), *draw)


def covariances(of: GaussianScene) -> np.ndarray:
    axes = matrix_from_quaternion(of.rotations) * np.exp(of.log_scales.astype(np.float64))[:, None, :]
    return np.asarray(axes @ axes.transpose(0, 2, 1))


def test_a_matrix_is_taken_apart() -> None:
    np.testing.assert_allclose(PLACEMENT.rotation, ROTATION, atol=1e-14)
    assert PLACEMENT.scale == pytest.approx(2.5, rel=1e-14)


def test_shapes_are_turned_and_scaled() -> None:
    """Covariances are s^2 R C R^T."""
    before = scene()
    after = PLACEMENT.scene(before)
    wanted = 2.5**2 * ROTATION @ covariances(before) @ ROTATION.T
    found = covariances(after)
    np.testing.assert_allclose(found, wanted, atol=1e-5 * np.abs(wanted).max())
    assert np.array_equal(after.opacity_logits, before.opacity_logits)
    wanted = 2.5 * (before.positions @ ROTATION.T) + [7.0, -1e4, 0.125]
    np.testing.assert_allclose(after.positions, wanted, rtol=1e-14)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_colours_go_with_the_directions(degree: int) -> None:
    before = scene(degree)
    after = PLACEMENT.scene(before)
    towards = RNG.normal(size=(40, 3))
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    seen = np.einsum("nb,nbc->nc", sh_basis(towards, degree), before.sh)
    turned = np.einsum("nb,nbc->nc", sh_basis(towards @ ROTATION.T, degree), after.sh)
    np.testing.assert_allclose(turned, seen, atol=1e-5)
    assert after.sh.dtype == np.float32


def test_what_rounding_left_of_a_rotation_is_one_again() -> None:
    rounded = np.array(ROWS, np.float32).astype(np.float64)
    rotation = Placement.of(rounded.tolist()).rotation
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(rotation) == pytest.approx(1)


def test_basis_is_orthonormal_on_the_sphere() -> None:
    """Pins all 16 constants at once: an integral over the sphere, by points evenly spread."""
    k = np.arange(20000) + 0.5
    z, angle = 1 - k / 10000, np.pi * (1 + 5**0.5) * k  # a Fibonacci sphere
    ring = np.sqrt(1 - z * z)
    directions = np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)
    basis = sh_basis(directions, 3)
    np.testing.assert_allclose(4 * np.pi * basis.T @ basis / 20000, np.eye(16), atol=2e-3)
