"""Opacity and colour: the formulas of SPEC §9.4, and what undoes them."""

from __future__ import annotations

import numpy as np

from scarfmt.scene.activation import (
    MAX_LOG_OPACITY,
    colour_from_spherical_harmonics,
    log_opacities,
    opacity_logits,
    spherical_harmonics_from_colour,
)


def test_opacity_logits_from_certain_to_vanishing() -> None:
    """Opacity 1 is capped, anything smaller keeps its value, nothing is NaN."""
    y = np.array([0.0, 5.0, MAX_LOG_OPACITY, -0.5, -40.0, -1e30, -np.inf])
    logits = opacity_logits(y)
    assert logits[0] == logits[1] == logits[2]
    assert 9.01 < logits[0] < 9.02
    np.testing.assert_allclose(1 / (1 + np.exp(-logits[2:5])), np.exp(y[2:5]), rtol=1e-12)
    assert logits[5] == -1e30
    assert logits[6] == -np.inf


def test_logarithms_of_opacities_are_undone() -> None:
    """Logits up to the cap come back from their logarithms; extreme ones stay finite."""
    logits = np.array([-400.0, -30.0, -3.0, 0.0, 5.0, 9.0])
    np.testing.assert_allclose(opacity_logits(log_opacities(logits)), logits, rtol=1e-9)
    assert abs(log_opacities(np.array([400.0], np.float32))[0]) < 1e-100


def test_colour_transform_is_the_inverse_of_its_definition() -> None:
    """(Y, G, O) of SPEC §9.4 gives back R, G, B."""
    red, green, blue = 0.3, -0.2, 0.9
    y = (red + 2 * green + blue) / 4
    coded = np.array([[y, green - y, (red - blue) / 2]])
    np.testing.assert_allclose(spherical_harmonics_from_colour(coded), [[red, green, blue]], atol=1e-15)


def test_colours_come_back() -> None:
    """Coding and decoding colours is the identity."""
    rgb = np.random.default_rng(0).normal(size=(50, 3))
    np.testing.assert_allclose(spherical_harmonics_from_colour(colour_from_spherical_harmonics(rgb)), rgb, atol=1e-14)
