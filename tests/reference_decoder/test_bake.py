"""Anchors baked into plain Gaussians, each slot fitted by itself, and what the PLY of them says."""

from __future__ import annotations

import io

import numpy as np

from fuzz.testing.scenes import random_scene
from reference_decoder.anchors import gaussians
from reference_decoder.bake import bake
from reference_decoder.decode import decode
from reference_decoder.stream_ply import Baking, export_ply
from scarfmt.coding.writer import write_scene
from scarfmt.container.schema import Profile
from scarfmt.formats import load
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.scene.harmonics import sh_basis

from .models import EYE, random_model


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


def anchor_file() -> bytes:
    files = [write_scene(random_scene(seed, Profile.ANCHOR)) for seed in range(8)]
    return next(data for data in files if decode(data).models.decoder is not None)


def test_baked_ply_says_that_it_is_lossy() -> None:
    out = io.BytesIO()
    count = export_ply(anchor_file(), out, baking=Baking(steps=0, sh_degree=1))
    assert b"comment baked from a .scar anchor model; lossy" in out.getvalue()[:200]
    scene = load(out.getvalue())
    assert isinstance(scene, GaussianScene)
    assert len(scene) == count > 0


def test_a_box_without_anchors_bakes_to_no_gaussians() -> None:
    out = io.BytesIO()
    assert export_ply(anchor_file(), out, box=([1e6] * 3, [2e6] * 3)) == 0
    assert b"element vertex 0" in out.getvalue()
