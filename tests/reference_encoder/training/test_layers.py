"""Layers of training: cells nest, plans are what files can hold."""


import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from reference_encoder.training.layers import LayerPlan, coarse


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
    assert all(plan.draws[-1] == 2 * other for other in plan.draws[:-1])
