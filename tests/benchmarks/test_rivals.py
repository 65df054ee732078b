"""Rival formats: their settings are fair, and what replaces a part of their writer is exact."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.rivals_formats import read, spz_scale
from benchmarks.rivals_kmeans import kmeans, nearest
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


def test_kmeans_is_exact_and_gives_an_idle_centroid_a_point() -> None:
    """The nearest against all distances in float64, over several tiles of centroids and of points."""
    random = np.random.default_rng(2)
    points, centroids = (random.normal(size=(count, 9)).astype(np.float32) for count in (300, 2100))
    distances = ((points[:, None].astype(np.float64) - centroids[None]) ** 2).sum(axis=2)
    found = distances[np.arange(len(points)), nearest(points, centroids)]
    assert np.abs(found - distances.min(axis=1)).max() < 1e-5
    middles = np.array([[0, 0], [10, 0], [0, 10]], np.float32)
    around = (np.repeat(middles, 50, axis=0) + random.normal(scale=0.1, size=(150, 2))).astype(np.float32)
    moved, labels = kmeans(around, around[[0, 60, 120]], 3)
    assert np.abs(moved - middles).max() < 0.1
    assert np.array_equal(labels, np.repeat([0, 1, 2], 50))
    few = np.array([[0.0], [1.0], [2.0]], np.float32)
    assert kmeans(few, np.array([[1.0], [1000.0]], np.float32), 1)[0][1, 0] in few
