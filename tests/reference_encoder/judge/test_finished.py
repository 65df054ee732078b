"""The scenes that the encoder judges equal those that decoders show."""

from __future__ import annotations

import numpy as np
import pytest

from fuzz.testing.scenes import random_scene as random_integers
from reference_decoder.decode import decode
from reference_encoder.judge.finished import finished_anchors, finished_gaussians
from reference_encoder.measure.anchor_sensitivity import anchor_view
from reference_encoder.options import EncodeOptions
from reference_encoder.pipeline import quantised
from scarfmt.coding.writer import write_scene
from scarfmt.container.schema import Profile
from scarfmt.render.metrics import psnr
from scarfmt.scene.gaussians import AnchorModel, GaussianScene
from tests.reference_encoder.profiles.test_anchors import picture, ring, small_model
from tests.render.scenes import random_scene

GAUSSIANS = ("positions", "log_scales", "rotations", "opacity_logits", "sh")
ANCHORS = ("anchors", "features", "offsets", "log_scaling", "slot_mask")


@pytest.mark.parametrize(("degree", "quality"), [(0, 40.0), (2, 30.0), (3, 50.0)])
def test_gaussians_are_those_that_are_decoded(degree: int, quality: float) -> None:
    """All attributes agree with those of the decoded file but for rounding, with and without latents."""
    options = EncodeOptions(quality=quality, effort=1, layers=3, corrections=0)
    scene = quantised(random_scene(1, 700, degree), options).scene
    shown, found = finished_gaussians(scene), decode(write_scene(scene)).scene
    assert isinstance(found, GaussianScene)
    for name in GAUSSIANS:
        np.testing.assert_allclose(getattr(shown, name), getattr(found, name), rtol=2e-6, atol=2e-6, err_msg=name)


@pytest.mark.parametrize("seed", range(6))
def test_so_they_are_whatever_a_file_holds(seed: int) -> None:
    """Finished scenes agree for random integers, and for files without some channels."""
    scene = random_integers(seed, Profile.EXPLICIT, anchors=200)
    shown, found = finished_gaussians(scene), decode(write_scene(scene)).scene
    assert isinstance(found, GaussianScene)
    for name in GAUSSIANS:
        np.testing.assert_allclose(getattr(shown, name), getattr(found, name), rtol=1e-4, atol=1e-4, err_msg=name)


def test_anchors_are_those_that_are_decoded() -> None:
    """The model, and the picture of it."""
    scene = quantised(small_model(), EncodeOptions(quality=40, effort=1, layers=3, corrections=0)).scene
    shown, found = finished_anchors(scene), decode(write_scene(scene)).scene
    assert isinstance(found, AnchorModel)
    for name in ANCHORS:
        np.testing.assert_allclose(getattr(shown, name), getattr(found, name), rtol=1e-5, atol=1e-5, err_msg=name)
    camera = ring(3)[1]
    assert psnr(anchor_view(shown)(camera), picture(found, camera)) > 70
