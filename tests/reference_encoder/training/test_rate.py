"""Bits in the loss: a proxy that has to be what a coder would take, everywhere, with gradients."""

import math

import pytest
import torch
from hypothesis import example, given
from hypothesis import strategies as st

from reference_encoder.training.rate import (
    CLOSED_BITS,
    MASK_BITS,
    OCCUPANCIES,
    POSITION_BITS,
    Context,
    Priced,
    cell_bits,
    columns,
    find_cells,
    layer_bits,
    neighbour_means,
)


def test_cells_of_a_distribution_are_all_of_it() -> None:
    """Probabilities of all cells add up to 1: the proxy is a code, not a penalty."""
    width = torch.tensor(0.3)
    values = width * torch.arange(-400, 401)
    bits = cell_bits(values, width, torch.tensor(0.2), torch.tensor(-0.5))
    assert float((2.0 ** -bits.double()).sum()) == pytest.approx(1.0, abs=1e-5)


@given(st.floats(-60, 60), st.floats(0.01, 4), st.floats(-3, 3), st.floats(-3, 2))
def test_bits_agree_with_binary64(value: float, width: float, mean: float, log_spread: float) -> None:
    """Far out, where the difference of two sigmoids is 0, bits and gradients stay finite and right."""
    x = torch.tensor(value, requires_grad=True)
    bits = cell_bits(x, torch.tensor(width), torch.tensor(mean), torch.tensor(log_spread))
    spread = math.exp(log_spread)
    high, low = (value - mean + width / 2) / spread, (value - mean - width / 2) / spread
    if low > 0:
        high, low = -low, -high
    exact = -(high - math.log1p(math.exp(high)) + math.log1p(-math.exp(low - high)) - math.log1p(math.exp(low)))
    assert float(bits.detach()) == pytest.approx(min(exact / math.log(2), 40.0), rel=1e-3, abs=1e-4)
    bits.backward()
    assert x.grad is not None
    assert math.isfinite(float(x.grad))


def test_a_context_learns_what_components_say_of_each_other() -> None:
    """A component that is a copy of an earlier one gets cheap; what comes later is never looked at."""
    generator = torch.Generator().manual_seed(0)
    first = torch.randn(4096, 1, generator=generator)
    values = torch.cat([first, torch.randn(4096, 4, generator=generator), first], dim=1)
    context, widths = Context(6), torch.full((6,), 0.25)
    context.start(values, torch.randn(10, 3, generator=generator))
    before = context.bits(values, widths).mean(dim=0)
    optimiser = torch.optim.Adam(context.parameters(), lr=0.02)
    for _ in range(300):
        optimiser.zero_grad()
        context.bits(values, widths).sum(dim=1).mean().backward()
        optimiser.step()
    after = context.bits(values, widths).mean(dim=0)
    assert after[5] < before[5] - 1.5
    assert after[0] > before[0] - 0.1
    changed = values.clone()
    changed[:, 5] += 1
    assert torch.equal(context.bits(changed, widths)[:, :5], context.bits(values, widths)[:, :5])


def _priced(shown: torch.Tensor) -> Priced:
    n = len(shown)
    return Priced(torch.randn(n, 8), torch.randn(n, 10, 3), shown, torch.full((8,), 0.1), torch.full((3,), 0.1))


def test_what_is_off_costs_nothing() -> None:
    """Only anchors that are there, and slots that are on, are paid for."""
    assert float(layer_bits(Context(8), _priced(torch.zeros(4, 10, dtype=torch.bool))).detach()) == 0
    shown = torch.zeros(4, 10, dtype=torch.bool)
    shown[1, 3] = True
    context, priced = Context(8), _priced(shown)
    values = context.bits(priced.values, priced.widths)[1].sum()
    offset = context.offset_bits(priced.offsets, priced.offset_widths)[1, 3].sum()
    expected = values + offset + POSITION_BITS + 10 * CLOSED_BITS + MASK_BITS
    assert float(layer_bits(context, priced).detach()) == pytest.approx(float(expected.detach()), rel=1e-5)


def test_indices_of_anchors_that_are_there_are_paid_for() -> None:
    """Codewords cost their bits once an anchor, not for those that are off."""
    shown = torch.zeros(4, 10, dtype=torch.bool)
    shown[:3] = True
    priced = _priced(shown)
    more = layer_bits(Context(8), priced, 7.0) - layer_bits(Context(8), priced)
    assert float(more.detach()) == pytest.approx(21.0, abs=1e-3)


def test_a_context_learns_from_neighbours() -> None:
    """Values that are what neighbours have get cheap; without neighbours they are not."""
    generator = torch.Generator().manual_seed(0)
    values = torch.randn(4096, 6, generator=generator)
    around = torch.zeros(4096, columns(6))
    around[:, :6] = values + 0.1 * torch.randn(4096, 6, generator=generator)
    context, widths = Context(6), torch.full((6,), 0.25)
    context.start(values, torch.randn(10, 3, generator=generator))
    optimiser = torch.optim.Adam(context.parameters(), lr=0.01)
    for _ in range(300):
        optimiser.zero_grad()
        context.bits(values, widths, around).sum(dim=1).mean().backward()
        optimiser.step()
    with torch.no_grad():
        assert float(context.bits(values, widths, around).mean()) < float(context.bits(values, widths).mean()) - 1


def test_means_are_of_the_others_in_the_cell() -> None:
    """An anchor does not see itself: its own value would be the answer. So few anchors are one cell."""
    lattice = torch.tensor([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    values = torch.tensor([[1.0], [2.0], [6.0]])
    around = neighbour_means(lattice, values)
    overall = float(values.mean())
    assert torch.allclose(around[0, :2], torch.tensor([(2.0 + 6.0 + overall) / 3, torch.log1p(torch.tensor(2.0))]))
    changed = values.clone()
    changed[0] += 4
    difference = neighbour_means(lattice, changed)[0, 0] - around[0, 0]
    assert torch.allclose(difference, torch.tensor(4 / 9))  # by the mean of all, not as its own neighbour


@given(st.integers(1, 300), st.integers(0, 100))
@example(2, 20)  # lies on two sides of 32
def test_cells_hold_as_many_as_they_shall(count: int, seed: int) -> None:
    """Cells are the smallest that hold enough on average; the whole scene is one if it has too few."""
    generator = torch.Generator().manual_seed(seed)
    lattice = torch.unique(torch.randint(0, 64, (count, 3), generator=generator), dim=0)
    for occupancy in OCCUPANCIES:
        counts = torch.bincount(find_cells(lattice, occupancy))
        assert int(counts.sum()) == len(lattice)
        assert len(counts) == 1 or len(lattice) >= occupancy * len(counts)
    assert neighbour_means(lattice, torch.randn(len(lattice), 5)).shape == (len(lattice), columns(5))
