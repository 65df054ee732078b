"""What is computed the same with any number of threads: products of matrices, and sums over many rows.

Torch shares them among its threads, and what a thread's share ends with is added up in another order: how depends on
the processor. Sigmoids that a share ends with have another formula. So products and sums are one thread's here. All
else that an iteration computes has the same bits anyway (docs/decisions/0061).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, cast

import torch
from torch import Tensor, nn
from torch.nn import functional


@contextmanager
def one_thread() -> Iterator[None]:
    """Torch on one thread."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


@one_thread()
def product_over_rows(a: Tensor, b: Tensor) -> Tensor:
    """(p, q) product of the transpose of (n, p) `a` with (n, q) `b`."""
    return a.T @ b


@one_thread()
def sum_over_rows(values: Tensor) -> Tensor:
    """(c,) sums of the (n, c) `values`."""
    return values.sum(dim=0)


@one_thread()
def total(values: Tensor) -> Tensor:
    """The sum of all numbers, with a gradient."""
    return values.sum()


def mean(values: Tensor) -> Tensor:
    """The mean of all numbers, with a gradient."""
    return total(values) / values.numel()


class _Linear(torch.autograd.Function):
    @staticmethod
    @one_thread()
    def forward(ctx: Any, inputs: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
        ctx.save_for_backward(inputs, weight)
        return functional.linear(inputs, weight, bias)

    @staticmethod
    @one_thread()
    def backward(ctx: Any, towards: Tensor) -> tuple[Tensor | None, Tensor, Tensor]:
        inputs, weight = ctx.saved_tensors
        to_inputs = towards @ weight if ctx.needs_input_grad[0] else None
        return to_inputs, product_over_rows(towards, inputs), sum_over_rows(towards)


def linear(inputs: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
    """(n, out) `inputs` (n, in) times the transpose of `weight` (out, in), and `bias` (out,)."""
    return cast(Tensor, _Linear.apply(inputs, weight, bias))  # type: ignore[no-untyped-call]


class Linear(nn.Linear):
    """A layer that computes :func:`linear`."""

    def forward(self, inputs: Tensor) -> Tensor:
        """(n, out) of (n, in)."""
        return linear(inputs, self.weight, self.bias)


class LayerNorm(nn.LayerNorm):
    """Numbers of each row with mean 0 and variance 1, times a weight a column, and a bias."""

    def forward(self, inputs: Tensor) -> Tensor:
        """(n, c) of (n, c)."""
        normal = functional.layer_norm(inputs, self.normalized_shape, eps=self.eps)
        return linear(normal, torch.diag(self.weight), self.bias)


class _Sigmoid(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor) -> Tensor:
        y = x.neg().exp_().add_(1).reciprocal_()
        ctx.save_for_backward(y)
        return y

    @staticmethod
    def backward(ctx: Any, towards: Tensor) -> Tensor:
        gradient: Tensor = torch.ops.aten.sigmoid_backward(towards, *ctx.saved_tensors)
        return gradient


def sigmoid(x: Tensor) -> Tensor:
    """1 / (1 + e^-x) of each number."""
    return cast(Tensor, _Sigmoid.apply(x))  # type: ignore[no-untyped-call]
