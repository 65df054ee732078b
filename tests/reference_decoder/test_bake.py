"""Anchors baked into plain Gaussians, each slot fitted by itself: from which eyes, and what the PLY of them says."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest

from fuzz.testing.scenes import random_scene
from reference_decoder.anchors import gaussians
from reference_decoder.bake import Baking, bake, default_views
from reference_decoder.decode import DecodeRequest, decode
from reference_decoder.stream_gaussians import stream_gaussians
from scarfmt.coding.writer import write_scene
from scarfmt.container.schema import Profile
from scarfmt.container.source import BytesSource
from scarfmt.errors import InvalidInput
from scarfmt.formats import load
from scarfmt.formats.outputs import write_parts
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.scene.placement import sh_basis

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


def test_baked_ply_says_that_it_is_lossy_and_a_box_without_anchors_makes_an_empty_one() -> None:
    source, baking = BytesSource(anchor_file()), Baking(steps=0, sh_degree=1)
    for request in (DecodeRequest(), DecodeRequest(box=([1e6] * 3, [2e6] * 3))):
        out = io.BytesIO()
        described, parts = stream_gaussians(source, request, baking=baking)
        count = write_parts("ply", parts, described, out).count
        assert (count > 0) == (request.box is None)
        assert (b"comment baked from a .scar anchor model; lossy" in out.getvalue()) == (count > 0)
        scene = load(out.getvalue())
        assert isinstance(scene, GaussianScene)
        assert len(scene) == count
    with pytest.raises(InvalidInput, match="no fixed Gaussians"):
        stream_gaussians(source, DecodeRequest())


def test_views_stand_round_the_anchors_and_look_at_them() -> None:
    """Further than the median anchor, within three times that, mostly above; each has the middle before it."""
    model = random_model(anchors=400)
    moved = replace(model, anchors=100 * model.anchors + 1e4)
    for scene in (model, moved):
        middle = np.median(scene.anchors, axis=0)
        radius = np.median(np.linalg.norm(scene.anchors - middle, axis=1))
        views = default_views(scene, 40)
        away = np.array([view.centre for view in views]) - middle
        distance = np.linalg.norm(away, axis=1) / radius
        assert (distance > 0.99).all()
        assert (distance < 3.01).all()
        assert len(np.unique(np.sign(away[:, [0, 2]]), axis=0)) == 4
        ahead = [view.world_to_camera[2, :3] @ (middle - view.centre) for view in views]
        assert min(ahead) > 0


def test_one_anchor_is_looked_at_too() -> None:
    views = default_views(random_model(anchors=1))
    assert all(np.isfinite(view.world_to_camera).all() for view in views)
