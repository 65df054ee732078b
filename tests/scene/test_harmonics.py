"""Spherical harmonics: the constants, and that turned coefficients are those of a turned function."""

from __future__ import annotations

import numpy as np
import pytest

from scarfmt.scene.harmonics import sh_basis, turned
from scarfmt.scene.rotation import matrix_from_quaternion


def test_basis_is_orthonormal_on_the_sphere() -> None:
    """Pins all 16 constants at once: an integral over the sphere, by points evenly spread."""
    k = np.arange(20000) + 0.5
    z, angle = 1 - k / 10000, np.pi * (1 + 5**0.5) * k  # a Fibonacci sphere
    ring = np.sqrt(1 - z * z)
    directions = np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)
    basis = sh_basis(directions, 3)
    np.testing.assert_allclose(4 * np.pi * basis.T @ basis / 20000, np.eye(16), atol=2e-3)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_what_was_seen_in_a_direction_is_seen_in_the_turned_one(degree: int) -> None:
    rng = np.random.default_rng(degree)
    rotation = matrix_from_quaternion(rng.normal(size=(1, 4)))[0]
    coefficients = rng.normal(size=2 * degree + 1)
    directions = rng.normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    band = slice(degree**2, (degree + 1) ** 2)
    before = sh_basis(directions, degree)[:, band] @ coefficients
    after = sh_basis(directions @ rotation.T, degree)[:, band] @ (turned(rotation, degree) @ coefficients)
    np.testing.assert_allclose(after, before, atol=1e-13)
