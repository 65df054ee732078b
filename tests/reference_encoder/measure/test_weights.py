"""The weights of Gaussians: power means over views, and a floor that needs no view."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from reference_encoder.measure.survey import Survey
from reference_encoder.measure.weights import weighed
from reference_encoder.tuning import SURVEY_POWER
from scarfmt.render.rasterise import contributions
from scarfmt.render.upright import Upright
from tests.render.scenes import random_scene, small_camera


def test_weights_are_power_means_over_views_and_kinds() -> None:
    """A weight is a power mean over the views of each kind, and then over kinds by their shares."""
    scene, views = random_scene(4, 300), [small_camera(), small_camera(33, 20), small_camera(50, 60)]
    shares = {"orbit": 0.75, "near": 0.25}
    found = weighed(scene, Survey({"orbit": views[:2], "near": views[2:]}, shares, 1.0, Upright("-y")))
    single = [contributions(scene, [view]).weight_sq / (3 * view.width * view.height) for view in views]
    powers = [weight**SURVEY_POWER for weight in single]
    expected = (0.75 * (powers[0] + powers[1]) / 2 + 0.25 * powers[2]) ** (1 / SURVEY_POWER)
    np.testing.assert_allclose(found.colour, np.maximum(expected, found.floor.colour), rtol=1e-5)


def test_what_nobody_sees_weighs_the_floor() -> None:
    """Behind every view: the floor, which grows with opacity and size; transparent ones weigh nothing."""
    scene = random_scene(5, 4)
    hidden = replace(
        scene,
        positions=scene.positions * 0 - np.array([0, 0, 100.0]),
        log_scales=np.log(np.float32([[0.005] * 3, [0.01] * 3, [0.01] * 3, [0.01] * 3])),
        opacity_logits=np.float32([3, 3, -3, -20]),
    )
    found = weighed(hidden, Survey({"orbit": [small_camera()]}, {"orbit": 1.0}, 1.0, Upright("-y")))
    assert found.largest.max() == 0
    small, large, faint, transparent = found.shape
    assert large == pytest.approx(4 * small, rel=0.05)
    assert large > faint > transparent == 0
