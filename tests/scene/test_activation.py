"""Opacity and colour: the formulas of SPEC §9.4, and what undoes them."""

from __future__ import annotations

import numpy as np

from scarfmt.scene.activation import (
    colour_from_spherical_harmonics,
    log_opacities,
    opacity_logits,
    spherical_harmonics_from_colour,
)


def test_logarithms_of_opacities_are_undone() -> None:
    """Logits up to the cap come back from their logarithms; extreme ones stay finite."""
    logits = np.array([-400.0, -30.0, -3.0, 0.0, 5.0, 9.0])
    np.testing.assert_allclose(opacity_logits(log_opacities(logits)), logits, rtol=1e-9)
    assert abs(log_opacities(np.array([400.0], np.float32))[0]) < 1e-100


def test_colours_come_back() -> None:
    """Coding and decoding colours is the identity."""
    rgb = np.random.default_rng(0).normal(size=(50, 3))
    np.testing.assert_allclose(spherical_harmonics_from_colour(colour_from_spherical_harmonics(rgb)), rgb, atol=1e-14)
