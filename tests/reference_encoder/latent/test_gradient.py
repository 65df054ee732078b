"""Gradient estimators (paper §3.3)."""

from __future__ import annotations

import pytest
import torch

from reference_encoder.latent.gradient import ESTIMATORS, rotation_trick, straight_through


def _pair(seed: int, rows: int = 1, width: int = 6) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    e, q = torch.randn(2, rows, width, generator=generator, dtype=torch.float64)
    return e, 3 * q


def _jacobian(estimator: object, e: torch.Tensor, q: torch.Tensor) -> torch.Tensor:
    assert callable(estimator)
    return torch.autograd.functional.jacobian(lambda x: estimator(x[None], q)[0], e[0])  # type: ignore[no-any-return]


@pytest.mark.parametrize("name", ESTIMATORS)
def test_forward_is_the_codeword(name: str) -> None:
    e, q = _pair(1, rows=100)
    torch.testing.assert_close(ESTIMATORS[name](e, q), q, rtol=0, atol=1e-14)


@pytest.mark.parametrize("seed", range(5))
def test_rotation_jacobian_is_a_rotation_times_the_length_ratio_and_maps_e_to_q(seed: int) -> None:
    e, q = _pair(seed)
    jacobian = _jacobian(rotation_trick, e, q)
    rotation = jacobian / (q.norm() / e.norm())
    torch.testing.assert_close(rotation @ rotation.T, torch.eye(6, dtype=torch.float64))
    torch.testing.assert_close(torch.linalg.det(rotation), torch.tensor(1.0, dtype=torch.float64))
    torch.testing.assert_close(jacobian @ e[0], q[0])


def test_rotation_leaves_directions_orthogonal_to_both_alone() -> None:
    e, q = _pair(7)
    across = torch.linalg.svd(torch.cat([e, q])).Vh[2:]
    scaled = _jacobian(rotation_trick, e, q) / (q.norm() / e.norm())
    torch.testing.assert_close(across @ scaled.T, across)


def test_straight_through_jacobian_is_the_identity() -> None:
    e, q = _pair(3)
    torch.testing.assert_close(_jacobian(straight_through, e, q), torch.eye(6, dtype=torch.float64))


def test_opposite_vectors_give_a_reflection_not_nan() -> None:
    e, _ = _pair(4)
    jacobian = _jacobian(rotation_trick, e, -2 * e)
    torch.testing.assert_close(jacobian @ jacobian.T, 4 * torch.eye(6, dtype=torch.float64))
    torch.testing.assert_close(jacobian @ e[0], -2 * e[0])


@pytest.mark.parametrize("zero", ["e", "q"])
def test_zero_vectors_go_straight_through(zero: str) -> None:
    e, q = _pair(5)
    e, q = (torch.zeros_like(e), q) if zero == "e" else (e, torch.zeros_like(q))
    torch.testing.assert_close(rotation_trick(e, q), q)
    torch.testing.assert_close(_jacobian(rotation_trick, e, q), torch.eye(6, dtype=torch.float64))
