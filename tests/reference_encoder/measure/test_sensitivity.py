"""The sensitivity model predicts what quantisation does to pictures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from reference_encoder.measure.attributes import from_scene
from reference_encoder.measure.sensitivity import Sensitivity, measure
from reference_encoder.measure.survey import Survey
from reference_encoder.measure.weights import KindWeights, weighed
from scarfmt.container.schema import Stream
from scarfmt.render.camera import Camera, orbit_cameras
from scarfmt.render.rasterise import render
from scarfmt.render.upright import Upright
from scarfmt.scene.gaussians import GaussianScene


@pytest.fixture(scope="module")
def scene() -> GaussianScene:
    """Two thousand half-transparent Gaussians of random colours in a shell."""
    draw = np.random.default_rng(2)
    normal = draw.normal(size=(2000, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return GaussianScene(
        normal * draw.uniform(0.8, 1.0, (2000, 1)),
        np.log(draw.uniform(0.02, 0.12, (2000, 3))).astype(np.float32),
        draw.normal(size=(2000, 4)).astype(np.float32),
        draw.normal(0, 1.5, 2000).astype(np.float32),
        draw.normal(0, 1, (2000, 1, 3)).astype(np.float32),
    )


@pytest.fixture(scope="module")
def cameras(scene: GaussianScene) -> list[Camera]:
    """A small view: of one, the power mean is the mean, which is what errors add up to."""
    return orbit_cameras(scene, 1, width=300, height=225)


@pytest.fixture(scope="module")
def model(scene: GaussianScene, cameras: list[Camera]) -> Sensitivity:
    """Sensitivities from those views."""
    return seen_from(scene, cameras)


def seen_from(scene: GaussianScene, cameras: list[Camera]) -> Sensitivity:
    """Sensitivities from some views, without the floor."""
    weights = weighed(scene, Survey({"orbit": cameras}, {"orbit": 1.0}, 1.0, Upright("-y")))
    nothing = np.zeros(len(scene), np.float32)
    return measure(from_scene(scene), replace(weights, floor=KindWeights(nothing, nothing)))


def measured(scene: GaussianScene, other: GaussianScene, cameras: list[Camera]) -> float:
    """Mean squared difference of the pictures of two scenes."""
    return float(np.mean([np.mean((render(scene, c) - render(other, c)) ** 2) for c in cameras]))


def test_colour_error_is_predicted(scene: GaussianScene, cameras: list[Camera], model: Sensitivity) -> None:
    """Independent colour errors give the summed squared error within a third."""
    error = np.random.default_rng(3).normal(0, 0.02, scene.sh.shape).astype(np.float32)
    predicted = float((model.colour * (error**2).sum(axis=(1, 2))).sum())
    assert measured(scene, replace(scene, sh=scene.sh + error), cameras) == pytest.approx(predicted, rel=1 / 3)


def test_opacity_error_is_predicted(scene: GaussianScene, cameras: list[Camera], model: Sensitivity) -> None:
    """Independent relative opacity errors are predicted within a factor of two."""
    attributes = from_scene(scene)
    error = np.random.default_rng(4).normal(0, 0.02, len(scene))
    log_opacity = np.minimum(attributes.log_opacity[:, 0] + error, -1e-4)
    logits = (log_opacity - np.log1p(-np.exp(log_opacity))).astype(np.float32)
    predicted = float((model.channels[Stream.OPACITY][:, 0] * error**2).sum())
    ratio = measured(scene, replace(scene, opacity_logits=logits), cameras) / predicted
    assert 0.5 < ratio < 2


def test_position_error_is_predicted(scene: GaussianScene, cameras: list[Camera], model: Sensitivity) -> None:
    """Independent position errors are predicted within a factor of four."""
    error = np.random.default_rng(5).normal(0, 0.001, scene.positions.shape)
    predicted = float((model.channels[Stream.POSITION_RESIDUAL] * error**2).sum())
    ratio = measured(scene, replace(scene, positions=scene.positions + error), cameras) / predicted
    assert 0.25 < ratio < 4


def test_hidden_gaussians_count_for_nothing(scene: GaussianScene, cameras: list[Camera]) -> None:
    """A Gaussian inside an opaque ball has no sensitivity; one in front has."""
    ball = GaussianScene(
        np.array([[0.0, 0, 0], [0.0, 0, 0]]),
        np.log(np.array([[0.01] * 3, [0.9] * 3])).astype(np.float32),
        np.array([[1.0, 0, 0, 0]] * 2, np.float32),
        np.array([9.0, 12.0], np.float32),
        np.ones((2, 1, 3), np.float32),
    )
    many = ball.take(np.array([0, 1, 1, 1, 1, 1]))
    positions = many.positions.copy()
    positions[1:] = [[1, 0, 0], [-1, 0, 0], [0, 0, 1], [0, 0, -1], [0, -1, 0]]
    surrounded = replace(many, positions=positions)
    found = seen_from(surrounded, cameras)
    assert found.colour[0] < 1e-4 * found.colour[1:].max()
