"""What is summed over many rows has the same bits with any number of threads, and is what torch computes."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import pytest
import torch
from torch import Tensor, nn

from reference_encoder.training.fixed_order import LayerNorm, Linear, mean, product_over_rows, sigmoid, sum_over_rows

SIZES = [(0, 3), (1, 2), (300, 70), (9000, 38), (60000, 3)]
"""Rows and columns: fewer than are taken at once, a few more, and so many that torch shares them."""


def drawn(*shape: int) -> Tensor:
    """Numbers of both signs."""
    return torch.randn(*shape, generator=torch.Generator().manual_seed(sum(shape)))


def with_threads(compute: Callable[[], list[Tensor]]) -> list[list[Tensor]]:
    """What is computed with one to eight threads."""
    found, before = [], torch.get_num_threads()
    try:
        for threads in (1, 2, 3, 4, 8):
            torch.set_num_threads(threads)
            found.append(compute())
    finally:
        torch.set_num_threads(before)
    return found


def check(compute: Callable[[], list[Tensor]], expected: Callable[[], list[Tensor]]) -> None:
    first, *others = with_threads(compute)
    for other in others:
        assert all(torch.equal(one, two) for one, two in zip(first, other, strict=True))
    torch.testing.assert_close(first, expected(), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize(("rows", "columns"), SIZES)
def test_sums(rows: int, columns: int) -> None:
    values, others = drawn(rows, columns), drawn(rows, 5)
    by_torch = [values.T @ others, values.sum(dim=0)]
    check(lambda: [product_over_rows(values, others), sum_over_rows(values)], lambda: by_torch)


@pytest.mark.parametrize(("rows", "columns"), SIZES[1:])
def test_means_and_sigmoids_with_their_gradients(rows: int, columns: int) -> None:
    def by(average: Callable[[Tensor], Tensor], squash: Callable[[Tensor], Tensor]) -> list[Tensor]:
        values = (50 * drawn(rows, columns)).requires_grad_()
        result = average(squash(values) * drawn(rows, columns))
        result.backward()  # type: ignore[no-untyped-call]
        return [result.detach(), rows * values.grad]

    check(lambda: by(mean, sigmoid), lambda: by(torch.mean, torch.sigmoid))


@pytest.mark.parametrize(("rows", "columns"), SIZES)
def test_layers_with_their_gradients(rows: int, columns: int) -> None:
    def by(layer: nn.Module) -> list[Tensor]:
        inputs = drawn(rows, columns).requires_grad_()
        outputs = layer(inputs)
        gradients = torch.autograd.grad(outputs, [inputs, *layer.parameters()], drawn(*outputs.shape) / 100)
        return [outputs.detach(), *gradients]

    for mine, theirs in ((Linear(columns, 16), nn.Linear(columns, 16)), (LayerNorm(columns), nn.LayerNorm(columns))):
        theirs.load_state_dict(mine.state_dict())
        check(partial(by, mine), partial(by, theirs))
