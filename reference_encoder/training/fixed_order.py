"""Sums in an order that does not depend on the number of threads: a run has the same bits with any.

Torch shares a sum over many rows among its threads, also inside a product of matrices, and computes the last few
sigmoids of each thread's share by another formula. What is here instead takes :data:`_ROWS` rows at a time, too few
to be shared, and adds their sums up in their order. All else that an iteration computes has the same bits anyway
(docs/decisions/0061).
"""

from __future__ import annotations

from typing import Any, cast

import torch
from torch import Tensor, nn
from torch.nn import functional

_ROWS = 256
_ONES = 4
"""Columns of ones that sum up rows: a product with a single column is one with a vector, which threads share."""


def product_over_rows(a: Tensor, b: Tensor) -> Tensor:
    """(p, q) product of the transpose of (n, p) `a` with (n, q) `b`; p and q are more than 1."""
    whole = len(a) // _ROWS * _ROWS
    rest = a[whole:].T @ b[whole:]
    if not whole:
        return rest
    parts = a[:whole].reshape(-1, _ROWS, a.shape[1]).transpose(1, 2) @ b[:whole].reshape(-1, _ROWS, b.shape[1])
    return sum_over_rows(parts.flatten(1)).view_as(rest) + rest


def sum_over_rows(values: Tensor) -> Tensor:
    """(c,) sums of the (n, c) `values`, c more than 1; without gradient."""
    return product_over_rows(values.new_ones(len(values), _ONES), values)[0]


def total(values: Tensor) -> Tensor:
    """The sum of all numbers, with a gradient."""
    flat = values.flatten()
    if len(flat) < _ROWS:
        return flat.sum()
    whole = len(flat) // _ROWS * _ROWS
    return total(flat[:whole].view(-1, _ROWS).sum(1)) + flat[whole:].sum()


def mean(values: Tensor) -> Tensor:
    """The mean of all numbers, with a gradient."""
    return total(values) / values.numel()


class _Linear(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, inputs: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
        ctx.save_for_backward(inputs, weight)
        return functional.linear(inputs, weight, bias)

    @staticmethod
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
