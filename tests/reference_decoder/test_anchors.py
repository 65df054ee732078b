"""Anchor profile: Gaussians for a camera."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from reference_decoder.anchors import SH_C0, gaussians
from reference_decoder.bake import bake
from scarfmt.errors import InvalidInput
from scarfmt.formats import load
from scarfmt.scene.gaussians import AnchorModel

from .models import EYE, random_model


@pytest.mark.parametrize("inputs", [8, 9])
def test_gaussians_are_the_formulas_slot_by_slot(inputs: int) -> None:
    """SPEC §9.6 written out for one slot at a time, with and without the distance as an input."""
    model = random_model(inputs=inputs)
    got = gaussians(model, EYE)
    expected = []
    for i in range(len(model)):
        away = model.anchors[i] - EYE
        distance = np.linalg.norm(away)
        u = np.concatenate([model.features[i], away / distance, [distance]])[:inputs]
        outputs = {}
        for name, mlp in model.mlps.items():
            outputs[name] = mlp.weights[1] @ np.maximum(mlp.weights[0] @ u + mlp.biases[0], 0) + mlp.biases[1]
        for k in range(model.slots):
            opacity = np.tanh(outputs["opacity"][k])
            if not model.slot_mask[i, k] or opacity <= 0:
                continue
            c, colour = outputs["cov"][7 * k : 7 * k + 7], 1 / (1 + np.exp(-outputs["color"][3 * k : 3 * k + 3]))
            scale = np.exp(model.log_scaling[i, 3:]) / (1 + np.exp(-c[:3]))
            centre = model.anchors[i] + model.offsets[i, k] * np.exp(model.log_scaling[i, :3])
            expected.append([i, k, opacity, *centre, *scale, *(c[3:] / np.linalg.norm(c[3:])), *colour])
    want = np.array(expected)
    scene = got.scene
    assert got.anchors.tolist() == want[:, 0].tolist()
    assert got.slots.tolist() == want[:, 1].tolist()
    shown = np.minimum(want[:, 2], np.exp(-(2.0**-13)))
    np.testing.assert_allclose(1 / (1 + np.exp(-scene.opacity_logits)), shown, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(scene.positions, want[:, 3:6], rtol=1e-6)
    np.testing.assert_allclose(np.exp(scene.log_scales), want[:, 6:9], rtol=1e-5)
    np.testing.assert_allclose(scene.rotations, want[:, 9:13], rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(got.colours, want[:, 13:], rtol=1e-5)
    np.testing.assert_allclose(0.5 + SH_C0 * scene.sh[:, 0], got.colours, rtol=1e-5)


def test_nothing_to_draw_is_an_empty_scene() -> None:
    model = random_model()
    hidden = AnchorModel(
        model.anchors, model.features, model.offsets, model.log_scaling, model.mlps, np.zeros((40, 3), np.bool_)
    )
    assert len(gaussians(hidden, EYE).scene) == 0
    assert len(bake(hidden, EYE[None])) == 0


def test_eye_at_an_anchor_gives_finite_gaussians() -> None:
    model = random_model()
    assert not gaussians(model, model.anchors[0]).scene.invalid_rows().any()


def test_model_without_networks_is_refused() -> None:
    model = random_model()
    bare = AnchorModel(model.anchors, model.features, model.offsets, model.log_scaling)
    for act in (lambda: gaussians(bare, EYE), lambda: bake(bare, EYE[None])):
        with pytest.raises(InvalidInput):
            act()


@pytest.mark.scene
def test_real_model_looks_like_its_photos(shared_data: Path) -> None:
    """A wrong reading of slots, directions or scales loses 10 dB against three held-out photos at half size."""
    from scarfmt.render.capture import load_cameras
    from scarfmt.render.images import read_image
    from scarfmt.render.metrics import psnr
    from scarfmt.render.rasterise import render

    model = load(shared_data / "anchors" / "plush-on-bed.npz")
    assert isinstance(model, AnchorModel)
    photos = shared_data / "photos" / "plush-on-bed"
    cameras = [camera for camera in load_cameras(photos / "cameras.json") if camera.split == "test"]
    decibels = []
    for camera in cameras[:3]:
        made = gaussians(model, camera.centre)
        picture = render(made.scene, camera, colours=made.colours)
        decibels.append(psnr(picture, read_image(photos / "images" / camera.name)))
    assert np.mean(decibels) > 30.5
