"""The linear latent: weighted Karhunen-Loève basis."""

from __future__ import annotations

import numpy as np
import pytest

from reference_encoder.rdo.latent import fit_latent
from reference_encoder.tuning import MAX_DIMENSIONS


def _vectors(count: int = 500, width: int = 9, rank: int = 3, seed: int = 0) -> np.ndarray:
    draw = np.random.default_rng(seed)
    return (draw.normal(size=(count, rank)) * [5, 2, 1][:rank] @ draw.normal(size=(rank, width))).astype(np.float32)


def test_vectors_of_low_rank_need_few_dimensions_and_come_back() -> None:
    x = _vectors()
    latent = fit_latent(x, np.ones(len(x)), tolerance=1e-3)
    assert latent.values.shape == (500, 3)
    assert np.abs(latent.decoder.apply(latent.values) - x).max() < 5e-3 * np.abs(x).max()


def test_squared_latent_distance_is_squared_error_times_weight() -> None:
    x, weight = _vectors(), np.linspace(0.5, 2, 500)
    latent = fit_latent(x, weight, tolerance=1e-3)
    moved = latent.values + np.float32([3, -2, 1])
    change = latent.decoder.apply(moved, np.float64) - latent.decoder.apply(latent.values, np.float64)
    np.testing.assert_allclose(weight * (change**2).sum(axis=1), latent.weight * 14.0, rtol=2e-3)


def test_dropped_dimensions_lose_less_than_the_tolerance() -> None:
    x = _vectors()
    tolerance = 0.05 * float((x.astype(np.float64) ** 2).sum())
    latent = fit_latent(x, np.ones(len(x)), tolerance)
    assert latent.values.shape[1] < 3
    assert ((latent.decoder.apply(latent.values, np.float64) - x) ** 2).sum() <= tolerance


def test_a_metric_makes_latent_distance_the_metrics_distance() -> None:
    x, draw = _vectors(rank=3), np.random.default_rng(1)
    factor = draw.normal(size=(9, 9))
    metric = factor @ factor.T + np.eye(9)
    latent = fit_latent(x + 4, np.ones(len(x)), 1e-3, metric)
    assert np.abs(latent.decoder.apply(latent.values) - x - 4).max() < 5e-3 * np.abs(x).max()
    moved = latent.values + np.float32([3, -2, 1])
    change = latent.decoder.apply(moved, np.float64) - latent.decoder.apply(latent.values, np.float64)
    expected = np.einsum("ni,ij,nj->n", change, metric, change)
    np.testing.assert_allclose(expected, latent.weight * 14.0, rtol=5e-3)
    flat = fit_latent(x, np.ones(len(x)), 1e-3, np.diag([1.0] * 3 + [0.0] * 6))
    assert np.isfinite(flat.decoder.apply(flat.values)).all()


def test_there_are_no_more_dimensions_than_a_file_holds() -> None:
    x = np.random.default_rng(0).normal(size=(99, MAX_DIMENSIONS + 1)).astype(np.float32)
    assert fit_latent(x, np.ones(len(x)), 0.0).values.shape == (99, MAX_DIMENSIONS)


@pytest.mark.parametrize(
    ("vectors", "weight"),
    [(np.zeros((4, 9), np.float32), np.ones(4)), (np.ones((4, 9), np.float32), np.zeros(4))],
)
def test_nothing_visible_is_no_latent(vectors: np.ndarray, weight: np.ndarray) -> None:
    assert fit_latent(vectors, weight, 0.0) is None
