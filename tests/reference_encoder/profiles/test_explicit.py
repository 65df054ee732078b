"""The explicit profile: kinds of views are weighed anew, and METADATA has the account."""

from __future__ import annotations

import numpy as np
import pytest

from reference_encoder.options import EncodeOptions
from reference_encoder.pipeline import attempted
from reference_encoder.profiles.explicit import ExplicitProfile
from scarfmt.scene.gaussians import GaussianScene
from tests.render.scenes import random_scene


@pytest.fixture(scope="module")
def profile() -> ExplicitProfile:
    scene = random_scene(3, 800, degree=1)
    logits = scene.opacity_logits.copy()
    logits[:50] = -20
    hidden = GaussianScene(scene.positions, scene.log_scales, scene.rotations, logits, scene.sh)
    return ExplicitProfile.measured(hidden, EncodeOptions(effort=1, quality=40))


def test_kinds_of_views_can_be_weighed_anew(profile: ExplicitProfile) -> None:
    """If only views from outside count, the sensitivities show it."""
    outside = profile.reweighted({"orbit": 1.0, "near": 0.0, "inside": 0.0})
    expected = np.maximum(profile.weights.kinds["orbit"].colour, profile.weights.floor.colour)
    np.testing.assert_allclose(outside.weights.colour, expected, rtol=1e-5)
    assert not np.allclose(outside.sensitivity.colour, profile.sensitivity.colour)


def test_what_is_left_out_is_counted_in_the_metadata(profile: ExplicitProfile) -> None:
    attempt = attempted(profile, 40.0)
    scene = profile.finish(attempt.problem, attempt.decision).scene
    told = scene.metadata["survey"]
    kept = sum(len(content) for content in scene.contents)
    assert sum(told["left_out"].values()) == 800 - kept
    assert told["left_out"]["invisible"] >= 50
    assert told["up"] == profile.options.frame
    assert 0 <= told["without_view_dependence"] <= kept
