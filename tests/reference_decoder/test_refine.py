"""Baked Gaussians fitted together to what the networks show."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from reference_decoder.anchors import gaussians
from reference_decoder.bake import bake, default_views
from reference_decoder.refine import refine
from scarfmt.formats import load
from scarfmt.render.camera import Camera
from scarfmt.render.capture import load_cameras
from scarfmt.render.metrics import psnr
from scarfmt.render.rasterise import render
from scarfmt.scene.gaussians import AnchorModel, GaussianScene

from .models import random_model


def quality(model: AnchorModel, scene: GaussianScene, views: list[Camera]) -> float:
    """Mean PSNR against the exact views, dB."""
    decibels = []
    for view in views:
        exact = gaussians(model, view.centre)
        decibels.append(psnr(render(scene, view), render(exact.scene, view, colours=exact.colours)))
    return float(np.mean(decibels))


@pytest.fixture(scope="module")
def case() -> tuple[AnchorModel, list[Camera], GaussianScene]:
    """A model whose networks depend on the view as much as trained ones do, views, and what bakes of it."""
    model = random_model(2, anchors=200)
    for mlp in model.mlps.values():
        mlp.weights[0][:, 5:] *= 0.3
    views = [view.scale(0.1) for view in default_views(model, 24)]
    return model, views, bake(model, np.array([view.centre for view in views[::2]]))


def test_refined_views_gain_decibels(case: tuple[AnchorModel, list[Camera], GaussianScene]) -> None:
    """From about 29.5 dB to 32.9."""
    model, views, baked = case
    before = quality(model, baked, views[::2])
    after = quality(model, refine(model, baked, views[::2], 60), views[::2])
    assert after > max(before + 2, 32.3), (before, after)


@pytest.mark.scene
def test_views_of_a_real_model_that_were_not_fitted_gain_decibels(shared_data: Path) -> None:
    model = load(shared_data / "anchors" / "plush-on-bed.npz")
    assert isinstance(model, AnchorModel)
    cameras = load_cameras(shared_data / "photos" / "plush-on-bed" / "cameras.json")
    fitted = [camera.scale(0.25) for camera in cameras if camera.split == "train"][::4]
    held_out = [camera.scale(0.25) for camera in cameras if camera.split == "test"][::4]
    baked = bake(model, np.array([camera.centre for camera in fitted]))
    before = quality(model, baked, held_out)
    after = quality(model, refine(model, baked, fitted, 60), held_out)
    assert after > before + 1, (before, after)


def test_same_arguments_same_scene_and_the_baked_one_is_kept(
    case: tuple[AnchorModel, list[Camera], GaussianScene],
) -> None:
    model, views, baked = case
    kept = {name: values.copy() for name, values in baked.arrays().items()}
    parts: list[float] = []
    first, second = (refine(model, baked, views, 4, lambda _stage, part: parts.append(part)) for _ in range(2))
    assert parts == [0.25, 0.5, 0.75, 1] * 2
    for name, values in baked.arrays().items():
        assert np.array_equal(values, kept[name])
        assert np.array_equal(getattr(first, name), getattr(second, name))
        assert getattr(first, name).dtype == values.dtype
    assert not np.array_equal(first.sh, baked.sh)
    assert not first.invalid_rows().any()
