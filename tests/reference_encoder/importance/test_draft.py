"""Weights without a survey: size and opacity alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from reference_encoder.importance.draft import weigh_draft
from reference_encoder.importance.view_sampling import SurveyViews
from scarfmt.render.viewpoints import Upright
from tests.render.scenes import random_scene

SURVEY = SurveyViews({}, {}, 1.0, Upright("-y"))


def test_weights_grow_with_size_and_opacity() -> None:
    scene = replace(
        random_scene(5, 4),
        log_scales=np.log(np.float32([[0.005] * 3, [0.01] * 3, [0.01] * 3, [0.01] * 3])),
        opacity_logits=np.float32([3, 3, -3, -20]),
    )
    small, large, faint, transparent = weigh_draft(scene, SURVEY).shape
    assert large == pytest.approx(4 * small, rel=0.05)
    assert large > faint > transparent == 0


def test_a_part_weighs_what_it_weighs_in_the_whole() -> None:
    scene = random_scene(5, 40)
    whole, part = weigh_draft(scene, SURVEY), weigh_draft(scene.take(np.arange(10)), SURVEY)
    np.testing.assert_array_equal(whole.colour[:10], part.colour)
