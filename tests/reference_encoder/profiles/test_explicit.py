"""The explicit profile: METADATA says what is left out."""

from __future__ import annotations

import pytest

from reference_encoder.encode import Encoder
from reference_encoder.options import EncodeOptions
from reference_encoder.profiles.explicit import ExplicitProfile
from scarfmt.scene.gaussians import GaussianScene
from tests.render.scenes import random_scene


@pytest.fixture(scope="module")
def profile() -> ExplicitProfile:
    scene = random_scene(3, 800, degree=1)
    logits = scene.opacity_logits.copy()
    logits[:50] = -20
    hidden = GaussianScene(scene.positions, scene.log_scales, scene.rotations, logits, scene.sh)
    return ExplicitProfile.measure(hidden, EncodeOptions(effort=1, quality=40))


def test_what_is_left_out_is_counted_in_the_metadata(profile: ExplicitProfile) -> None:
    scene = Encoder(profile).trial(40.0).scene
    told = scene.metadata["survey"]
    kept = sum(len(content) for content in scene.contents)
    assert sum(told["left_out"].values()) == 800 - kept
    assert told["left_out"]["invisible"] >= 50
    assert told["up"] == profile.options.frame
    assert 0 <= told["without_view_dependence"] <= kept
