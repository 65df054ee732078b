"""Explicit profile: activations, and float32 within tolerance of float64."""

from __future__ import annotations

import numpy as np
import pytest

from fuzz.testing.scenes import random_scene
from reference_decoder.decode import decode
from scarfmt.coding.writer import write_scene
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.scene.rotation import axes_from, matrix_from_quaternion, quaternion_from

TOLERANCE = 1e-5


def test_float32_is_within_tolerance_of_float64() -> None:
    for seed in range(12):
        decoded = decode(write_scene(random_scene(seed, anchors=400)))
        fast, exact = decoded.scene, decoded.activated(np.float64)
        assert isinstance(fast, GaussianScene)
        assert isinstance(exact, GaussianScene)
        assert exact.sh.dtype == np.float64
        assert fast.positions.tobytes() == exact.positions.tobytes()
        for name in ("log_scales", "rotations", "opacity_logits", "sh"):
            a, b = getattr(fast, name), getattr(exact, name)
            assert a.dtype == np.float32
            assert (np.abs(a - b) <= TOLERANCE * np.maximum(1, np.abs(b))).all(), name


def test_scene_has_the_degree_of_the_file_also_before_any_latent() -> None:
    for degree in range(4):
        data = write_scene(random_scene(9, sh_degree=degree, layers=4))
        for layers in range(1, 5):
            scene = decode(data, layers=layers).scene
            assert isinstance(scene, GaussianScene)
            assert scene.sh_degree == degree


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_quaternions_are_the_rotation_of_the_axes(dtype: type) -> None:
    rng = np.random.default_rng(1)
    square, twist = rng.uniform(-1.3, 1.3, (2000, 2)), rng.uniform(-5, 5, 2000)
    square[:4] = [[0, 0], [1, 1], [-1, 1], [1, 0]]
    q = quaternion_from(square.astype(dtype), twist.astype(dtype))
    assert q.dtype == dtype
    assert (q[:, 0] >= 0).all()
    np.testing.assert_allclose(matrix_from_quaternion(q), axes_from(square, twist), atol=4 * np.finfo(dtype).eps)
