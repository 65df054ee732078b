"""Weights without a survey: size and opacity alone."""

from __future__ import annotations

import numpy as np
import pytest

from reference_encoder.importance.view_sampling import Views
from reference_encoder.importance.weights import weigh_draft
from scarfmt.render.viewpoints import Upright
from tests.reference_encoder.importance.test_weights import of_sizes_and_opacities
from tests.render.scenes import random_scene

SURVEY = Views({}, {}, 1.0, Upright("-y"))


def test_weights_grow_with_size_and_opacity() -> None:
    found = weigh_draft(of_sizes_and_opacities(), SURVEY)
    assert (found.largest == 1).all()  # none counts as invisible where nobody has looked
    small, large, faint, transparent = found.shape
    assert large == pytest.approx(4 * small, rel=0.05)
    assert large > faint > transparent == 0


def test_a_part_weighs_what_it_weighs_in_the_whole() -> None:
    scene = random_scene(5, 40)
    whole, part = weigh_draft(scene, SURVEY), weigh_draft(scene.take(np.arange(10)), SURVEY)
    np.testing.assert_array_equal(whole.colour[:10], part.colour)
