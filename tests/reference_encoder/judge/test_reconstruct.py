"""What the encoder thinks a decoder will show is what the decoder shows."""

from __future__ import annotations

import numpy as np
import pytest
from reference_encoder.judge.reconstruct import reconstructed, rough

from reference_decoder.decode import decode
from reference_encoder.decide.assemble import anchor_order
from reference_encoder.options import EncodeOptions
from reference_encoder.pipeline import attempted
from reference_encoder.profiles.explicit import ExplicitProfile
from scarfmt.coding.writer import write_scene
from scarfmt.scene.gaussians import GaussianScene
from tests.render.scenes import random_scene

FIELDS = ("positions", "log_scales", "rotations", "opacity_logits", "sh")


@pytest.mark.parametrize(("degree", "quality"), [(0, 40.0), (2, 30.0), (3, 50.0)])
def test_reconstruction_is_what_is_decoded(degree: int, quality: float) -> None:
    """All attributes agree with those of the decoded file but for float32 rounding, with and without latents."""
    options = EncodeOptions(quality=quality, effort=1, layers=3, corrections=0)
    profile = ExplicitProfile.measured(random_scene(1, 700, degree), options)
    tried = attempted(profile, quality)
    found = decode(write_scene(profile.finish(tried.problem, tried.decision).scene)).scene
    shown = reconstructed(tried.problem, tried.decision)
    placement = tried.problem.geometry.placement
    shown = shown.take(anchor_order(tried.decision.model, placement, tried.decision.classes))
    assert isinstance(found, GaussianScene)
    for name in FIELDS:
        np.testing.assert_allclose(getattr(shown, name), getattr(found, name), rtol=2e-5, atol=2e-5, err_msg=name)


def test_rough_layers_hold_the_classes_they_say() -> None:
    """A rough scene has the anchors of the first classes, and of the last the most important part."""
    options = EncodeOptions(quality=45, effort=1, layers=2, corrections=0)
    tried = attempted(ExplicitProfile.measured(random_scene(2, 900, 1), options), 45)
    entry = (0, *(2 for _ in tried.plans.channels), 0)
    sizes = np.bincount(tried.problem.classes.of)
    whole = rough(tried.problem, tried.plans, [entry] * 2)
    half = rough(tried.problem, tried.plans, [entry] * 2, 0.5)
    assert len(whole) == sizes[:2].sum()
    assert len(half) == sizes[0] + round(sizes[1] / 2)
    assert not whole.sh[:, 1:].any()
