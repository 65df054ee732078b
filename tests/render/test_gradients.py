"""Derivatives of a picture agree with differences of pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from scarfmt.render.camera import Camera, look_at
from scarfmt.render.gradients import gradients
from scarfmt.render.projection import Drawable
from scarfmt.render.rasterise import render
from scarfmt.scene.gaussians import GaussianScene
from tests.samples.codec_samples import refuses

COUNT = 8
CAMERA = look_at(np.array([0, 0, -40.0]), np.zeros(3), np.array([0, -1.0, 0]), 24, 18, 4.0, near=0.1)
STEP = 1e-2


def smooth_scene() -> GaussianScene:
    """Gaussians that cover the whole picture: none enters or leaves a pixel, which no derivative shows."""
    rng = np.random.default_rng(1)
    return GaussianScene(
        rng.normal(0, 0.4, (COUNT, 3)),
        rng.uniform(0.3, 1.2, (COUNT, 3)).astype(np.float32),
        rng.normal(size=(COUNT, 4)).astype(np.float32),
        rng.uniform(-1.5, 0, COUNT).astype(np.float32),
        rng.uniform(-1, 1, (COUNT, 1, 3)).astype(np.float32),
    )


TARGET = np.random.default_rng(2).random((CAMERA.height, CAMERA.width, 3)).astype(np.float32)


def half_loss(scene: GaussianScene, camera: Camera = CAMERA) -> float:
    return 0.5 * gradients(Drawable.of(scene), camera, TARGET)[0]


def slope(change: Callable[[int, float], GaussianScene], row: int) -> float:
    return (half_loss(change(row, STEP)) - half_loss(change(row, -STEP))) / (2 * STEP)


def changed(scene: GaussianScene, name: str, place: tuple[int, ...], by: float) -> GaussianScene:
    values = getattr(scene, name).copy()
    values[place] += by
    return replace(scene, **{name: values})


def turned(scene: GaussianScene, row: int, axis: int, by: float) -> GaussianScene:
    """A Gaussian turned about one of its own axes."""
    w, x, y, z = scene.rotations[row].astype(np.float64)
    about = [(-x, w, z, -y), (-y, -z, w, x), (-z, y, -x, w)][axis]
    rotations = scene.rotations.copy()
    rotations[row] = np.array([w, x, y, z]) + by / 2 * np.array(about)
    return replace(scene, rotations=rotations)


def close(found: NDArray[np.float64], expected: list[float], part: float = 2e-3) -> None:
    np.testing.assert_allclose(found, expected, rtol=0, atol=part * np.abs(expected).max())


def test_error_is_that_of_the_picture() -> None:
    scene = smooth_scene()
    error, found = gradients(Drawable.of(scene), CAMERA, TARGET)
    expected = ((render(scene, CAMERA).astype(np.float64) - TARGET) ** 2).sum()
    assert error == pytest.approx(expected, rel=1e-5)
    assert found.index.tolist() == list(range(COUNT))


def test_slopes_are_those_of_differences() -> None:
    scene = smooth_scene()
    found = gradients(Drawable.of(scene), CAMERA, TARGET)[1]
    rows = range(COUNT)
    close(found.logit, [slope(lambda i, h: changed(scene, "opacity_logits", (i,), h), i) for i in rows])
    for axis in range(3):
        # One unit of the spherical harmonic of degree 0 is 0.28 of colour.
        by_sh = [slope(lambda i, h, a=axis: changed(scene, "sh", (i, 0, a), h), i) for i in rows]  # type: ignore[misc]
        close(0.28209479177387814 * found.colour[:, axis], by_sh)
        sizes = [slope(lambda i, h, a=axis: changed(scene, "log_scales", (i, a), h), i) for i in rows]  # type: ignore[misc]
        close(found.log_scale[:, axis], sizes)
        turns = [slope(lambda i, h, a=axis: turned(scene, i, a, h), i) for i in rows]  # type: ignore[misc]
        close(found.turn[:, axis], turns)
    for axis in range(3):
        places = [slope(lambda i, h, a=axis: changed(scene, "positions", (i, a), h), i) for i in rows]  # type: ignore[misc]
        close(found.position[:, axis], places, 0.02)


def test_what_is_clamped_has_no_slope() -> None:
    """A colour below 0; what no view shows is not listed."""
    scene = smooth_scene()
    dark = replace(scene, sh=np.full_like(scene.sh, -9))
    assert not gradients(Drawable.of(dark), CAMERA, TARGET)[1].colour.any()
    behind = replace(scene, positions=scene.positions - [0, 0, 90])
    assert len(gradients(Drawable.of(behind), CAMERA, TARGET)[1].index) == 0


def test_a_picture_of_another_size_is_refused() -> None:
    refuses("input-shape", lambda: gradients(Drawable.of(smooth_scene()), CAMERA, TARGET[1:]))
