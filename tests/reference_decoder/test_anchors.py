"""Anchor profile: Gaussians for a camera, and the Gaussians baked from them."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest

from fuzz.testing.scenes import random_scene
from reference_decoder.anchors import SH_C0, gaussians, outlook, unit_quaternions
from reference_decoder.bake import bake, default_eyes, sh_basis
from reference_decoder.decode import decode
from reference_decoder.stream_ply import export_ply
from scarfmt.coding.writer import write_scene
from scarfmt.container.schema import Profile
from scarfmt.errors import InvalidInput
from scarfmt.formats import load
from scarfmt.scene.gaussians import AnchorModel, GaussianScene, Mlp

EYE = np.array([0.5, -2.0, 3.0])


def random_model(seed: int = 0, anchors: int = 40, slots: int = 3, features: int = 5, inputs: int = 9) -> AnchorModel:
    rng = np.random.default_rng(seed)

    def perceptron(outputs: int) -> Mlp:
        weights = rng.normal(size=(8, inputs)) / 2, rng.normal(size=(outputs, 8)) / 2
        biases = rng.normal(size=8), rng.normal(size=outputs)
        return Mlp(
            (weights[0].astype(np.float32), weights[1].astype(np.float32)),
            (biases[0].astype(np.float32), biases[1].astype(np.float32)),
        )

    mlps = {"opacity": perceptron(slots), "cov": perceptron(7 * slots), "color": perceptron(3 * slots)}
    return AnchorModel(
        rng.normal(size=(anchors, 3)),
        rng.normal(size=(anchors, features)).astype(np.float32),
        rng.normal(size=(anchors, slots, 3)).astype(np.float32),
        rng.normal(-2, 0.5, (anchors, 6)).astype(np.float32),
        mlps,
        rng.random((anchors, slots)) < 0.7,
    )


@pytest.mark.parametrize("inputs", [8, 9])
def test_gaussians_are_the_formulas_slot_by_slot(inputs: int) -> None:
    """SPEC §9.6 written out for one slot at a time, with and without the distance as an input."""
    model = random_model(inputs=inputs)
    got = gaussians(model, EYE, np.float64)
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
    np.testing.assert_allclose(1 / (1 + np.exp(-scene.opacity_logits)), shown, rtol=1e-9)
    np.testing.assert_allclose(scene.positions, want[:, 3:6], rtol=1e-6)
    np.testing.assert_allclose(np.exp(scene.log_scales), want[:, 6:9], rtol=1e-6)
    np.testing.assert_allclose(scene.rotations, want[:, 9:13], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(got.colours, want[:, 13:], rtol=1e-6)
    np.testing.assert_allclose(0.5 + SH_C0 * scene.sh[:, 0], got.colours, rtol=1e-6)


def test_float32_is_within_tolerance_of_float64() -> None:
    fast, exact = (gaussians(random_model(3, 500), EYE, dtype) for dtype in (np.float32, np.float64))
    # A slot whose opacity is nearly 0 may be drawn by one and not by the other.
    both = {pair: row for row, pair in enumerate(zip(exact.anchors.tolist(), exact.slots.tolist(), strict=True))}
    pairs = list(zip(fast.anchors.tolist(), fast.slots.tolist(), strict=True))
    rows = np.array([both[pair] for pair in pairs if pair in both])
    kept = np.array([pair in both for pair in pairs])
    assert kept.sum() >= len(exact.anchors) - 1
    for name in ("log_scales", "rotations", "sh"):
        a, b = getattr(fast.scene, name)[kept], getattr(exact.scene, name)[rows]
        assert a.dtype == np.float32
        assert (np.abs(a - b) <= 1e-5 * np.maximum(1, np.abs(b))).all(), name


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


@pytest.mark.parametrize("distance", [1e-320, 1e-200, 1e200, 1e307])
def test_directions_do_not_depend_on_the_distance(distance: float) -> None:
    """Squares of it over- or underflow in float64 (SPEC §9.6); float32 may not hold it, without a warning."""
    model = random_model()
    steps = np.random.default_rng(4).integers(-5, 6, (40, 3)).astype(np.float64)
    seen = AnchorModel(steps * distance, model.features, model.offsets, model.log_scaling, model.mlps, model.slot_mask)
    with np.errstate(all="raise", under="ignore"):
        found = outlook(seen, np.arange(40), np.zeros(3), np.float64)[:, 5:]
        single = outlook(seen, np.arange(40), np.zeros(3), np.float32)[:, 5:]
    # What float64 makes of the steps; below 1e-308 not all of their digits.
    steps = seen.anchors / distance
    long = np.linalg.norm(steps, axis=1, keepdims=True)
    np.testing.assert_allclose(found[:, :3], steps / np.where(long > 0, long, 1), rtol=1e-12)
    np.testing.assert_allclose(found[:, 3:] / distance, long, rtol=1e-3 if distance < 1e-300 else 1e-12)
    np.testing.assert_allclose(single[:, :3], found[:, :3], rtol=1e-7)


@pytest.mark.parametrize("length", [1e-44, 1e-30, 1e-20, 1, 1e20, 1e38])
def test_quaternions_have_length_one_however_long_they_were(length: float) -> None:
    """In float32, where the squares of most of these vanish or overflow."""
    q = (np.array([[2, 0, 0, 0], [0, 0, 2, 0], [1, -1, 1, 1], [0, 0, 0, 0]]) * length).astype(np.float32)
    expected = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0.5, -0.5, 0.5, 0.5], [1, 0, 0, 0]], np.float32)
    assert np.array_equal(unit_quaternions(q), expected)
    assert np.array_equal(unit_quaternions(np.full((1, 4), np.nan, np.float32)), expected[:1])


def test_model_without_networks_is_refused() -> None:
    model = random_model()
    bare = AnchorModel(model.anchors, model.features, model.offsets, model.log_scaling)
    for act in (lambda: gaussians(bare, EYE), lambda: bake(bare, EYE[None])):
        with pytest.raises(InvalidInput):
            act()


def test_bake_from_one_eye_is_what_that_eye_sees() -> None:
    """With a single eye there is nothing to compromise on: only the ridge moves the colours, a little."""
    model = random_model(5)
    seen, baked = gaussians(model, EYE), bake(model, EYE[None], sh_degree=1)
    visible = seen.scene.opacity_logits > np.log(1 / 254)
    np.testing.assert_allclose(baked.positions, seen.scene.positions[visible])
    np.testing.assert_allclose(baked.opacity_logits, seen.scene.opacity_logits[visible], rtol=1e-4, atol=1e-4)
    lengths = np.sort(seen.scene.log_scales[visible], axis=1)
    np.testing.assert_allclose(baked.log_scales, lengths, atol=1e-4)
    towards = baked.positions - EYE
    basis = sh_basis(towards / np.linalg.norm(towards, axis=1, keepdims=True), 1)
    colours = 0.5 + np.einsum("nb,nbc->nc", basis, baked.sh)
    np.testing.assert_allclose(colours, seen.colours[visible], atol=0.01)


def test_basis_is_orthonormal_on_the_sphere() -> None:
    """Pins all 16 constants at once: an integral over the sphere, by points evenly spread."""
    directions = default_eyes(np.zeros((1, 3)), 20000) / 2.0
    basis = sh_basis(directions, 3)
    np.testing.assert_allclose(4 * np.pi * basis.T @ basis / 20000, np.eye(16), atol=2e-3)


def anchor_files() -> list[bytes]:
    files = [write_scene(random_scene(seed, Profile.ANCHOR)) for seed in range(8)]
    return [data for data in files if decode(data).models.decoder is not None]


def test_decoded_model_makes_gaussians() -> None:
    """Layer by layer, and never of a slot whose mask is off."""
    drawn = 0
    for data in anchor_files():
        decoded = decode(data)
        assert isinstance(decoded.scene, AnchorModel)
        made = gaussians(decoded.scene, EYE)
        assert decoded.slots[made.anchors, made.slots].all()
        drawn += len(made.scene)
    assert drawn > 100


def test_baked_ply_says_that_it_is_lossy() -> None:
    out = io.BytesIO()
    count = export_ply(anchor_files()[0], out, bake_degree=1)
    assert b"comment baked from a .scar anchor model; lossy" in out.getvalue()[:200]
    scene = load(out.getvalue())
    assert isinstance(scene, GaussianScene)
    assert len(scene) == count > 0


@pytest.mark.scene
def test_real_model_looks_like_its_photos(shared_data: Path) -> None:
    """A wrong reading of slots, directions or scales loses 10 dB; three held-out photos at half size will tell."""
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
