"""Layers of training: cells nest, plans are what files can hold."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from reference_encoder.training.layers import LayerPlan, coarse


@given(st.lists(st.tuples(st.integers(-10_000, 10_000), st.integers(0, 3)), min_size=1, max_size=20))
def test_coarse_values_are_cells_of_fine_ones(rows: list[tuple[int, int]]) -> None:
    """v_n = 3 v_(n-1) + t with t in -1, 0, 1 (SPEC §7.5): the digits between are trits, of each row as many as said."""
    values, steps = torch.tensor(rows).unbind(1)
    fine = values.double()[:, None]
    assert torch.equal(coarse(fine, torch.zeros_like(steps)), fine)
    for less in range(3):
        after, before = coarse(fine, (steps - less - 1).clamp_min(0)), coarse(fine, (steps - less).clamp_min(0))
        one_step = steps > less
        assert bool(((after - 3 * before).abs() <= 1)[one_step].all())
        assert torch.equal(after[~one_step], before[~one_step])


@pytest.mark.parametrize("count", range(1, 9))
def test_what_only_the_last_layer_shows_stays_coarse(count: int) -> None:
    """One step less than others have in the end, but one at least, and never less than a layer before (SPEC §6.5)."""
    plan = LayerPlan.of(count, 2.0)
    last = count - 1
    for first in range(count):
        steps = [plan.steps_of(layer, first) for layer in range(first, count)]
        assert steps == sorted(steps)
        assert steps[0] >= 1
        assert steps[-1] == (plan.steps[-1] if first < last or plan.steps[-1] == 1 else plan.steps[-1] - 1)
        missing = plan.missing(last, torch.tensor([first]))
        assert missing.tolist() == [plan.steps[-1] - steps[-1]]


@pytest.mark.parametrize("count", range(1, 9))
def test_plans_grow(count: int) -> None:
    """Prefixes get larger, never coarser, and the last has all that there is."""
    plan = LayerPlan.of(count, 5.0)
    assert plan.count == count
    assert plan.steps[0] == 1
    assert list(plan.steps) == sorted(plan.steps)
    assert list(plan.shares) == sorted(plan.shares)
    assert plan.shares[-1] == 1
    assert len(plan.draws) == count
    assert all(plan.draws[-1] == 5 * other for other in plan.draws[:-1])
