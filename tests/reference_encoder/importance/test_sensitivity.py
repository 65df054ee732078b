"""The sensitivity model predicts what quantisation does to pictures."""

from __future__ import annotations

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest

from reference_encoder.importance import weights as module
from reference_encoder.importance.attributes import from_scene
from reference_encoder.importance.sensitivity import Sensitivity, measure_sensitivity
from reference_encoder.importance.view_sampling import Views
from reference_encoder.importance.weights import weigh_scene
from scarfmt.container.schema import Stream
from scarfmt.render.camera import Camera, orbit_cameras
from scarfmt.render.rasterise import render
from scarfmt.render.viewpoints import Upright
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
    with patch.object(module, "FLOOR_SHARE", 0.0):
        weights = weigh_scene(scene, Views({"orbit": cameras}, {"orbit": 1.0}, 1.0, Upright("-y")))
    return measure_sensitivity(from_scene(scene), weights)


def measured(scene: GaussianScene, other: GaussianScene, cameras: list[Camera]) -> float:
    """Mean squared difference of the pictures of two scenes."""
    return float(np.mean([np.mean((render(scene, c) - render(other, c)) ** 2) for c in cameras]))


@pytest.mark.parametrize(
    ("attribute", "stream", "size", "within"),
    [
        ("sh", None, 0.02, 4 / 3),
        ("opacity", Stream.OPACITY, 0.02, 2),
        ("positions", Stream.POSITION_RESIDUAL, 0.001, 4),
    ],
)
def test_errors_are_predicted(
    scene: GaussianScene,
    cameras: list[Camera],
    model: Sensitivity,
    attribute: str,
    stream: Stream | None,
    size: float,
    within: float,
) -> None:
    """The summed squared error of independent errors: of colours within a third, of positions within a factor."""
    draw = np.random.default_rng(3)
    weights = model.colour[:, None] if stream is None else model.channels[stream]
    if attribute == "opacity":
        error = draw.normal(0, size, (len(scene), 1))
        log_opacity = np.minimum(from_scene(scene).log_opacity + error, -1e-4)[:, 0]
        other = replace(scene, opacity_logits=(log_opacity - np.log1p(-np.exp(log_opacity))).astype(np.float32))
    else:
        values = getattr(scene, attribute)
        error = draw.normal(0, size, values.shape).astype(values.dtype)
        other = replace(scene, **{attribute: values + error})
    predicted = float((weights * error.reshape(len(scene), -1) ** 2).sum())
    assert 1 / within < measured(scene, other, cameras) / predicted < within


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
