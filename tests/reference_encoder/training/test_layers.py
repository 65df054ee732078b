"""Layers of training: gates only ever open, cells nest, plans are what files can hold."""

import itertools

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from reference_encoder.training.layers import LayerPlan, coarse, falls_to, gate_logits, hard_gate


@given(seed=st.integers(0, 1000), layers=st.integers(1, 6))
def test_a_gate_that_is_open_stays_open(seed: int, layers: int) -> None:
    """A slot that a layer shows is shown by all later ones: a file takes nothing back (SPEC §6.5)."""
    generator = torch.Generator().manual_seed(seed)
    last = 4 * torch.randn(5, 3, generator=generator)
    falls = 4 * torch.randn(5, 3, layers - 1, generator=generator)
    shown = [gate_logits(last, falls, layer) > 0 for layer in range(layers)]
    for earlier, later in itertools.pairwise(shown):
        assert bool((later | ~earlier).all())


def test_falls_give_the_wanted_logits() -> None:
    """Layers start where they were put, and below the layer after them where they were put above it."""
    last = torch.tensor([[2.0, 1.0]])
    falls = falls_to(last, [torch.tensor([[-1.0, 3.0]]), torch.tensor([[0.5, 0.9]])])
    assert torch.allclose(gate_logits(last, falls, 1), torch.tensor([[0.5, 0.9]]), atol=1e-5)
    first = gate_logits(last, falls, 0)
    assert first[0, 0] == pytest.approx(-1.0, abs=1e-5)
    assert first[0, 1] == pytest.approx(0.9 - 1e-3, abs=1e-4)


def test_a_hard_gate_is_one_or_nothing_and_pulls_like_a_sigmoid() -> None:
    """Forward nothing is half open; backward a closed gate still feels what opening it would do."""
    logits = torch.tensor([-3.0, 0.0, 0.1], requires_grad=True)
    gates = hard_gate(logits)
    assert gates.tolist() == pytest.approx([0.0, 0.0, 1.0], abs=1e-6)
    gates.sum().backward()
    s = torch.sigmoid(torch.tensor([-3.0, 0.0, 0.1]))
    assert logits.grad is not None
    assert torch.allclose(logits.grad, s * (1 - s))


@given(st.lists(st.integers(-10_000, 10_000), min_size=1, max_size=20), st.integers(0, 3))
def test_coarse_values_are_cells_of_fine_ones(values: list[int], steps: int) -> None:
    """v_n = 3 v_(n-1) + t with t in -1, 0, 1 (SPEC §7.5): the digits between are trits."""
    fine = torch.tensor(values, dtype=torch.float64)
    before = coarse(fine, steps)
    for step in range(steps, 0, -1):
        after = coarse(fine, step - 1)
        assert bool(((after - 3 * before).abs() <= 1).all())
        before = after


@pytest.mark.parametrize("count", range(1, 9))
def test_plans_grow(count: int) -> None:
    """Prefixes get larger, never coarser, and the last has all that there is."""
    plan = LayerPlan.of(count)
    assert plan.count == count
    assert plan.steps[0] == 1
    assert list(plan.steps) == sorted(plan.steps)
    assert list(plan.shares) == sorted(plan.shares)
    assert plan.shares[-1] == 1
    assert len(plan.draws) == count
