"""Rival formats: their settings are fair."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.rivals_formats import read, spz_scale
from scarfmt.scene.gaussians import GaussianScene
from tests.formats.scene_files import scene_ply


def make_scene(count: int = 200, degree: int = 3, size: float = 1.0) -> GaussianScene:
    random = np.random.default_rng(1)
    rotations = random.normal(size=(count, 4))
    return GaussianScene(
        random.normal(size=(count, 3)).astype(np.float32).astype(np.float64) * size,
        random.uniform(-8, -2, (count, 3)).astype(np.float32) + np.float32(np.log(size)),
        (rotations / np.linalg.norm(rotations, axis=1, keepdims=True)).astype(np.float32),
        random.uniform(-4, 4, count).astype(np.float32),
        random.normal(scale=0.1, size=(count, (degree + 1) ** 2, 3)).astype(np.float32),
    )


def test_reading_undoes_the_scale(tmp_path: Path) -> None:
    source, ply = make_scene(size=32.0), tmp_path / "a.ply"
    ply.write_bytes(scene_ply(source))
    assert np.array_equal(read(ply, 32).positions, source.positions / 32)
    assert np.abs(read(ply, 32).log_scales - (source.log_scales - np.log(32))).max() < 1e-5


@pytest.mark.parametrize("size", [1e-3, 1.0, 5e3])
def test_the_scale_for_spz_is_a_power_of_two_that_keeps_the_scene_in_range(size: float) -> None:
    source = make_scene(size=size)
    scale = spz_scale(source, 32)
    assert np.log2(scale) % 1 == 0
    assert np.abs(source.positions).max() * scale <= 2047
    assert source.log_scales.max() + np.log(scale) <= 255 / 16 - 10 + 1e-6
