"""Spherical harmonics: colours turn with the scene."""

from __future__ import annotations

import numpy as np
import pytest

from scarfmt.scene.harmonics import sh_basis, turned
from scarfmt.scene.rotation import matrix_from_quaternion


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_a_turned_scene_has_its_colours_in_turned_directions(degree: int) -> None:
    rng = np.random.default_rng(degree)
    rotation = matrix_from_quaternion(rng.normal(size=(1, 4)))[0]
    directions = rng.normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    sh = rng.normal(size=(3, (degree + 1) ** 2, 3)).astype(np.float32)
    seen = np.einsum("db,nbc->ndc", sh_basis(directions @ rotation.T, degree), turned(sh, rotation))
    np.testing.assert_allclose(seen, np.einsum("db,nbc->ndc", sh_basis(directions, degree), sh), atol=1e-5)


def test_a_half_turn_changes_signs_only() -> None:
    """Rotations about an axis by a half turn are exact elsewhere, as changes of sign: the two must agree."""
    from scarfmt.formats.frame import RUB_TO_RDF, flip_axes
    from tests.formats.odd_scenes import odd_scene

    scene = odd_scene(1, 20, 3)
    flipped = flip_axes(scene, RUB_TO_RDF)
    np.testing.assert_allclose(turned(scene.sh, np.diag(np.float64(RUB_TO_RDF))), flipped.sh, atol=1e-5)
