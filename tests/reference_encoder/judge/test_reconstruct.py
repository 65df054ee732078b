"""The scenes that the encoder judges equal those that decoders show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fuzz.testing.scenes import random_scene as random_integers
from reference_decoder.decode import decode
from reference_encoder.encode import Encoder, measure_scene
from reference_encoder.importance.anchor_sensitivity import draw_anchors
from reference_encoder.judge.reconstruct import PreviewScene, reconstruct_anchors, reconstruct_gaussians
from reference_encoder.options import EncodeOptions
from reference_encoder.rdo.layers import price_layers
from reference_encoder.tuning import NEIGHBOURS
from scarfmt.coding.writer import QuantisedScene, write_scene
from scarfmt.container.registries import ColourSpace, RenderModel
from scarfmt.container.schema import Profile, Stream
from scarfmt.render.metrics import psnr
from scarfmt.render.rasterise import render
from scarfmt.scene.description import Description
from scarfmt.scene.gaussians import AnchorModel, GaussianScene
from tests.reference_encoder.profiles.test_anchors import picture, ring, small_model
from tests.render.scenes import random_scene

GAUSSIANS = ("positions", "log_scales", "rotations", "opacity_logits", "sh")
ANCHORS = ("anchors", "features", "offsets", "log_scaling", "slot_mask")


def quantise(scene: GaussianScene | AnchorModel, options: EncodeOptions) -> QuantisedScene:
    """All integers of its file."""
    return Encoder(measure_scene(scene, options)).run().scene


@pytest.mark.parametrize(("degree", "quality"), [(0, 40.0), (2, 30.0), (3, 50.0)])
def test_gaussians_are_those_that_are_decoded(degree: int, quality: float) -> None:
    """All attributes agree with those of the decoded file but for rounding, with and without latents."""
    options = EncodeOptions(quality=quality, effort=1, layers=3, corrections=0)
    linear = Description(colour_space=ColourSpace.LINEAR)
    scene = quantise(replace(random_scene(1, 700, degree), description=linear), options)
    assert scene.fields.colour_space == ColourSpace.LINEAR
    shown, found = reconstruct_gaussians(scene), decode(write_scene(scene)).scene
    for name in GAUSSIANS:
        np.testing.assert_allclose(getattr(shown, name), getattr(found, name), rtol=2e-6, atol=2e-6, err_msg=name)


@pytest.mark.parametrize("seed", range(6))
def test_so_they_are_whatever_a_file_holds(seed: int) -> None:
    """Finished scenes agree for random integers, and for files without some channels."""
    scene = random_integers(seed, Profile.EXPLICIT, anchors=200)
    scene = replace(scene, fields=replace(scene.fields, render_model=RenderModel.ANTIALIASED))
    shown, found = reconstruct_gaussians(scene), decode(write_scene(scene)).scene
    for name in GAUSSIANS:
        np.testing.assert_allclose(getattr(shown, name), getattr(found, name), rtol=1e-4, atol=1e-4, err_msg=name)
    assert shown.description == found.description


def test_anchors_are_those_that_are_decoded() -> None:
    """The model, and the picture of it."""
    scene = quantise(small_model(), EncodeOptions(quality=40, effort=1, layers=3, corrections=0))
    shown, found = reconstruct_anchors(scene), decode(write_scene(scene)).scene
    for name in ANCHORS:
        np.testing.assert_allclose(getattr(shown, name), getattr(found, name), rtol=1e-5, atol=1e-5, err_msg=name)
    camera = ring(3)[1]
    assert psnr(draw_anchors(shown)(camera), picture(found, camera)) > 70


def test_previews_hold_the_classes_they_say() -> None:
    """The anchors of the first classes, and of each class the given part; colours beyond degree 0 only with latents."""
    options = EncodeOptions(quality=45, effort=1, layers=1, corrections=0)
    trial = Encoder(measure_scene(random_scene(2, 900, 1), options)).run().layered
    steps = tuple(0 if curve.stream == Stream.LATENT else 2 for curve in trial.curves)
    sizes = np.bincount(trial.problem.classes.of)
    preview = PreviewScene.of(trial.problem, trial.curves)
    whole, half = preview.reconstruct([steps] * 2), preview.reconstruct([steps] * 2, (1.0, 0.5))
    assert len(whole) == sizes[:2].sum()
    assert abs(len(half) - sizes[0] - sizes[1] / 2) <= NEIGHBOURS / 2
    assert not whole.sh[:, 1:].any()
    finest = [tuple(9 for _ in trial.curves)] * len(sizes)
    fine = preview.reconstruct(finest)
    assert fine.sh[:, 1:].any()
    places, true = np.sort(fine.positions, axis=0), np.sort(trial.problem.positions, axis=0)
    np.testing.assert_allclose(places, true, atol=1e-3 * trial.problem.placement.cell.min())


def test_previews_of_the_last_layer_are_near_what_is_decoded() -> None:
    """With all steps of the last layer, every Gaussian is the one of the file but for the rounding of its values."""
    options = EncodeOptions(quality=45, effort=1, layers=1, corrections=0)
    trial = Encoder(measure_scene(random_scene(2, 900, 1), options)).run()
    problem, curves = trial.layered.problem, trial.layered.curves
    preview, costs = PreviewScene.of(problem, curves), price_layers(problem, curves)
    shown = preview.reconstruct(costs.steps(costs.final))
    found = reconstruct_gaussians(trial.scene)
    camera = ring(3)[1]
    assert psnr(render(shown, camera), render(found, camera)) > 40
