"""What the encoder thinks a decoder will show is what the decoder shows."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from reference_decoder.decode import decode
from reference_encoder import explicit_profile
from reference_encoder.decide.assemble import anchor_order
from reference_encoder.measure.reconstruct import reconstructed, rough
from reference_encoder.options import EncodeOptions
from scarfmt.coding.writer import write_scene
from scarfmt.scene.gaussians import GaussianScene
from tests.render.scenes import random_scene

FIELDS = ("positions", "log_scales", "rotations", "opacity_logits", "sh")


@pytest.mark.parametrize(("degree", "quality"), [(0, 40.0), (2, 30.0), (3, 50.0)])
def test_reconstruction_is_what_is_decoded(monkeypatch: pytest.MonkeyPatch, degree: int, quality: float) -> None:
    """All attributes agree with those of the decoded file but for float32 rounding, with and without latents."""
    scene = random_scene(1, 700, degree)
    decided: list[tuple[Any, Any]] = []
    contents = explicit_profile.contents

    def watched(problem: Any, decision: Any) -> Any:
        decided.append((problem, decision))
        return contents(problem, decision)

    attempts: list[Any] = []
    attempt = explicit_profile._attempt
    monkeypatch.setattr(explicit_profile, "contents", watched)
    monkeypatch.setattr(explicit_profile, "_attempt", lambda *a: attempts.append(attempt(*a)) or attempts[-1])
    options = EncodeOptions(quality=quality, effort=1, layers=3, corrections=0)
    quantised, _ = explicit_profile.encode_explicit(scene, options)
    found = decode(write_scene(quantised)).scene
    problem, decision = decided[0]
    shown = reconstructed(attempts[-1].positions, degree, problem, decision)
    shown = shown.take(anchor_order(decision.model, problem.placement, decision.classes))
    assert isinstance(found, GaussianScene)
    for name in FIELDS:
        np.testing.assert_allclose(getattr(shown, name), getattr(found, name), rtol=2e-5, atol=2e-5, err_msg=name)


def test_rough_layers_hold_the_classes_they_say(monkeypatch: pytest.MonkeyPatch) -> None:
    """A rough scene has the anchors of the first classes, and of the last the most important part."""
    attempts: list[Any] = []
    attempt = explicit_profile._attempt
    monkeypatch.setattr(explicit_profile, "_attempt", lambda *a: attempts.append(attempt(*a)) or attempts[-1])
    scene = random_scene(2, 900, 1)
    explicit_profile.encode_explicit(scene, EncodeOptions(quality=45, effort=1, layers=2, corrections=0))
    tried = attempts[-1]
    entry = (0, *(2 for _ in tried.plans.channels), 0)
    sizes = np.bincount(tried.problem.classes)
    whole = rough(tried.positions, 1, tried.problem, tried.plans, [entry] * 2)
    half = rough(tried.positions, 1, tried.problem, tried.plans, [entry] * 2, 0.5)
    assert len(whole) == sizes[:2].sum()
    assert len(half) == sizes[0] + round(sizes[1] / 2)
    assert not whole.sh[:, 1:].any()
