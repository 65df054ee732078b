"""Attributes keep what a renderer sees, and context choice finds what predicts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from reference_encoder.importance.attributes import MIN_LOG_OPACITY, from_scene, visible_attributes
from scarfmt.container.registries import RenderModel
from scarfmt.scene.description import Description
from scarfmt.scene.gaussians import GaussianScene


def test_extremes_stay_finite() -> None:
    """Logits of +-400, scales of e^+-90 and zero quaternions give finite attributes."""
    scene = GaussianScene(
        np.zeros((4, 3)),
        np.array([[-90, 0, 90]] * 4, np.float32),
        np.zeros((4, 4), np.float32),
        np.array([400, -400, 0, 30], np.float32),
        np.zeros((4, 4, 3), np.float32),
    )
    attributes = from_scene(scene)
    for values in (attributes.log_scales, attributes.rotation, attributes.log_opacity, attributes.colour):
        assert np.isfinite(values).all()
    assert abs(attributes.log_opacity[0, 0]) < 1e-12
    assert attributes.log_opacity[1, 0] == MIN_LOG_OPACITY
    assert (np.diff(attributes.log_scales, axis=1) <= 0).all()


def test_axes_hidden_in_a_pixel_are_as_long_as_that_and_others_stay() -> None:
    scales = np.array([[0.0, -1.0, -30.0], [0.0, -1.0, -2.0]], np.float32)
    colours = np.zeros((2, 1, 3), np.float32)
    turned = np.tile(np.array([1, 0, 0, 0], np.float32), (2, 1))
    scene = GaussianScene(np.zeros((2, 3)), scales, turned, np.zeros(2, np.float32), colours)
    found = visible_attributes(scene, np.array([0.01, 0.01], np.float32)).log_scales
    assert np.array_equal(found[1], scales[1])
    assert np.array_equal(found[0, :2], scales[0, :2])
    # A hundredth of the variance of a blurred pixel, which is 0.4 pixels^2.
    assert np.isclose(np.exp(2 * found[0, 2]), 0.01 * 0.4 * 0.01**2)
    far = visible_attributes(scene, np.array([np.inf, 0], np.float32)).log_scales
    assert np.isfinite(far).all()
    faint = replace(scene, description=Description(RenderModel.ANTIALIASED))
    assert np.array_equal(visible_attributes(faint, np.ones(2, np.float32)).log_scales, scales)
