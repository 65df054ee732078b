"""The view that a file opens with: of the subject, from the side that shows most, outside of fog."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from reference_encoder import opening_view
from reference_encoder.opening_view import find_opening_view, middle_camera
from reference_encoder.options import EncodeOptions
from scarfmt.arrays import F64
from scarfmt.render.camera import Camera, look_at
from scarfmt.render.rasterise import render
from scarfmt.scene.gaussians import GaussianScene

OPTIONS = EncodeOptions(frame="y")


def _gaussians(positions: F64, colours: F64, log_scale: float = -3.0, logit: float = 4.0) -> GaussianScene:
    count = len(positions)
    return GaussianScene(
        positions,
        np.full((count, 3), log_scale, np.float32),
        np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        np.full(count, logit, np.float32),
        ((colours - 0.5) / 0.28209479177387814).astype(np.float32)[:, None],
    )


def _ball(count: int = 4000) -> GaussianScene:
    """A grey ball, chequered where z is positive."""
    normal = np.random.default_rng(3).normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    chequered = (np.floor(normal[:, 0] * 5) + np.floor(normal[:, 1] * 5)) % 2
    colours = np.where(normal[:, 2] > 0, chequered, 0.5)[:, None] * np.ones(3)
    return _gaussians(normal, colours)


def _joined(one: GaussianScene, other: GaussianScene) -> GaussianScene:
    arrays = ("positions", "log_scales", "rotations", "opacity_logits", "sh")
    return replace(one, **{name: np.concatenate([getattr(one, name), getattr(other, name)]) for name in arrays})


def _away(camera: Camera) -> F64:
    """(3,) unit vector from the middle to the eye."""
    return np.asarray(camera.centre / np.linalg.norm(camera.centre))


def test_it_shows_the_side_that_has_most_detail() -> None:
    assert _away(find_opening_view(_ball(), OPTIONS))[2] > 0.7


def test_a_subject_fills_the_frame_and_none_of_it_is_cut_off() -> None:
    """The edge of the picture is empty; what is not is most of its height. Most of the scene lies at one end of it."""
    moon = _ball(400)
    scene = _joined(_ball(), replace(moon, positions=moon.positions * 0.3 + [2.0, 1.5, 0.0]))
    lit = render(scene, find_opening_view(scene, OPTIONS).sample(4)).max(axis=2) > 0.1
    assert not lit[[0, -1]].any()
    assert not lit[:, [0, -1]].any()
    assert np.ptp(np.flatnonzero(lit.any(axis=1))) > 0.7 * len(lit)


def test_fog_before_the_subject_is_avoided() -> None:
    """Large faint Gaussians before the side with most detail: the view is from another."""
    place = np.random.default_rng(4).normal(0, 0.15, (60, 3)) + np.array([0, 0.3, 2.0])
    fog = _gaussians(place, np.random.default_rng(5).uniform(0, 1, (60, 3)), log_scale=-1.2, logit=0.0)
    camera = find_opening_view(_joined(_ball(), fog), OPTIONS)
    assert np.linalg.norm(camera.centre - [0, 0.3, 2.0]) > 0.8


def test_of_many_gaussians_those_that_cover_most_decide(monkeypatch: pytest.MonkeyPatch) -> None:
    ball = _ball()
    dust = replace(ball, log_scales=np.full_like(ball.log_scales, -12.0), positions=-ball.positions)
    monkeypatch.setattr(opening_view, "OPENING_GAUSSIANS", len(ball))
    assert _away(find_opening_view(_joined(dust, ball), OPTIONS))[2] > 0.7


@pytest.mark.parametrize(("count", "logit"), [(1, 4.0), (2, 4.0), (2, -80.0)])
def test_a_scene_of_next_to_nothing_has_one_too(count: int, logit: float) -> None:
    scene = _gaussians(np.zeros((count, 3)), np.ones((count, 3)), logit=logit)
    assert np.isfinite(find_opening_view(scene, EncodeOptions()).world_to_camera).all()


def test_of_given_cameras_the_one_amid_the_others_is_taken() -> None:
    """Also of few; a single one is amid all there are."""
    cameras = [look_at(np.array([x, 0.0, -5.0]), np.array([x, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), 8, 6)
               for x in (0.0, 9.0, 10.0, 20.0)]  # fmt: skip
    assert middle_camera(cameras) is cameras[1]
    assert middle_camera(cameras[:1]) is cameras[0]
