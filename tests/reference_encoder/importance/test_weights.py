"""The weights of Gaussians: power means over views, and a floor that needs no view."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from reference_encoder.importance.view_sampling import Views
from reference_encoder.importance.weights import weigh_draft, weigh_scene, weigh_unoccluded
from reference_encoder.tuning import FLOOR_DISTANCE, SURVEY_POWER
from scarfmt.render.rasterise import contributions_by_view
from scarfmt.render.viewpoints import Upright
from scarfmt.scene.gaussians import GaussianScene
from tests.render.scenes import random_scene, small_camera


def test_weights_are_power_means_over_views_and_kinds() -> None:
    """A weight is a power mean over the views of each kind, and then over kinds by their shares."""
    scene, views = random_scene(4, 300), [small_camera(), small_camera(33, 20), small_camera(50, 60)]
    shares = {"orbit": 0.75, "near": 0.25}
    found = weigh_scene(scene, Views({"orbit": views[:2], "near": views[2:]}, shares, 1.0, Upright("-y")))
    single, largest = np.zeros((len(views), len(scene))), np.zeros(len(scene), np.float32)
    for weights, view, seen in zip(single, views, contributions_by_view(scene, views), strict=True):
        weights[seen.index] = seen.weight_sq / (3 * view.width * view.height)
        largest[seen.index] = np.maximum(largest[seen.index], seen.weight_max)
    powers = [weight**SURVEY_POWER for weight in single]
    expected = (0.75 * (powers[0] + powers[1]) / 2 + 0.25 * powers[2]) ** (1 / SURVEY_POWER)
    _, floor = weigh_unoccluded(scene, FLOOR_DISTANCE, len(scene))
    np.testing.assert_allclose(found.colour, np.maximum(expected, floor), rtol=1e-5)
    np.testing.assert_array_equal(found.largest, largest)


def of_sizes_and_opacities() -> GaussianScene:
    """A small Gaussian, a large one, a faint and a transparent one."""
    sizes = np.log(np.float32([[0.005] * 3, [0.01] * 3, [0.01] * 3, [0.01] * 3]))
    return replace(random_scene(5, 4), log_scales=sizes, opacity_logits=np.float32([3, 3, -3, -20]))


def assert_grown(weights: np.ndarray) -> None:
    """Weights of those four grow with size and opacity."""
    small, large, faint, transparent = weights
    assert large == pytest.approx(4 * small, rel=0.05)
    assert large > faint > transparent == 0


def test_what_nobody_sees_weighs_the_floor() -> None:
    """Behind every view: the floor, which grows with opacity and size; transparent ones weigh nothing."""
    scene = of_sizes_and_opacities()
    hidden = replace(scene, positions=scene.positions * 0 - np.array([0, 0, 100.0]))
    found = weigh_scene(hidden, Views({"orbit": [small_camera()]}, {"orbit": 1.0}, 1.0, Upright("-y")))
    assert found.largest.max() == 0
    assert_grown(found.shape)


def test_weights_without_a_survey_grow_with_size_and_opacity() -> None:
    found = weigh_draft(of_sizes_and_opacities(), Views({}, {}, 1.0, Upright("-y")))
    assert (found.largest == 1).all()  # none counts as invisible where nobody has looked
    assert_grown(found.shape)


def test_a_part_weighs_what_it_weighs_in_the_whole() -> None:
    scene = random_scene(5, 40)
    whole, part = (weigh_draft(some, Views({}, {}, 1.0, Upright("-y"))) for some in (scene, scene.take(np.arange(10))))
    np.testing.assert_array_equal(whole.colour[:10], part.colour)
