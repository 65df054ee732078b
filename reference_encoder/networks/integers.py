"""Integer operations of the index network in torch, with gradients of their smooth counterparts (SPEC §10.1).

Tensors are float32 and carry integers: every exact result is below 2^24. Backward, a rounding counts as the
identity and a table as the function it samples: the straight-through estimator.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import torch

from reference_encoder.jit import compiled
from scarfmt.arrays import F32, Bools
from scarfmt.neural.tables import EXP2, SIGMOID, TANH

_HALF, _NOTHING = np.float32(0.5), np.float32(0)

_TANH = torch.tensor([*(-v for v in reversed(TANH[1:])), *TANH], dtype=torch.float32)
_SIGMOID = torch.tensor([*(4096 - v for v in reversed(SIGMOID[1:])), *SIGMOID], dtype=torch.float32)
_LAST = 255
TANH_ONE, SIGMOID_ONE = 2047.0, 4096.0
UNIT = 32.0
"""Pre-activations are in 32nds, logits in 32nds of a bit."""
TOTAL = 1 << 24
"""Sum of the frequencies of a symbol (SPEC §8.1)."""


class _Round(torch.autograd.Function):
    @staticmethod
    def forward(_ctx: Any, x: torch.Tensor) -> torch.Tensor:
        return torch.floor(x + 0.5)

    @staticmethod
    def backward(_ctx: Any, grad: torch.Tensor) -> torch.Tensor:
        return grad


@compiled
def _settle(x: F32, scale: np.float32, low: np.float32, high: np.float32, out: F32, free: Bools) -> None:
    """Fill `out` with round(x * scale), clamped, and `free` with where the clamp did nothing."""
    for k in range(len(x)):
        value = np.floor(x[k] * scale + _HALF)
        free[k] = (value >= low) & (value <= high)
        out[k] = min(max(value, low), high)


@compiled
def _unsettle(grad: F32, free: Bools, scale: np.float32, out: F32) -> None:
    for k in range(len(grad)):
        out[k] = grad[k] * scale if free[k] else _NOTHING


class _Settle(torch.autograd.Function):
    """Rounding shift and clamp in one pass."""

    @staticmethod
    def forward(ctx: Any, x: torch.Tensor, scale: float, low: float, high: float) -> torch.Tensor:
        values = np.ascontiguousarray(x.detach().numpy())
        out, ctx.free, ctx.scale = np.empty_like(values), np.empty(values.shape, np.bool_), np.float32(scale)
        _settle(values.ravel(), ctx.scale, np.float32(low), np.float32(high), out.ravel(), ctx.free.ravel())
        return torch.from_numpy(out)

    @staticmethod
    def backward(ctx: Any, grad: torch.Tensor) -> Any:
        given = np.ascontiguousarray(grad.numpy())
        out = np.empty_like(given)
        _unsettle(given.ravel(), ctx.free.ravel(), ctx.scale, out.ravel())
        return torch.from_numpy(out), None, None, None


class _Table(torch.autograd.Function):
    """A table of a sigmoid shape, from -top + 2 * centre to top, looked up at integers."""

    @staticmethod
    def forward(ctx: Any, x: torch.Tensor, table: torch.Tensor) -> torch.Tensor:
        out = table[x.clamp(-_LAST, _LAST).long() + _LAST]
        ctx.save_for_backward(out)
        ctx.low, ctx.high = (0.0, SIGMOID_ONE) if table is _SIGMOID else (-TANH_ONE, TANH_ONE)
        return out

    @staticmethod
    def backward(ctx: Any, grad: torch.Tensor) -> Any:
        (out,) = ctx.saved_tensors
        # d/du of both, u in 32nds: (y - low)(high - y) / (high - low) is that of a logistic; tanh is twice as steep.
        steep = 1.0 if ctx.low == 0 else 2.0
        return grad * (out - ctx.low) * (ctx.high - out) * (steep / (UNIT * (ctx.high - ctx.low))), None


def rounded(x: torch.Tensor, exact: bool) -> torch.Tensor:
    """floor(x + 1/2), or `x` itself in the float model."""
    if not exact:
        return x
    return cast(torch.Tensor, _Round.apply(x))  # type: ignore[no-untyped-call]


def round_shift(x: torch.Tensor, shift: int, exact: bool) -> torch.Tensor:
    """x / 2^shift to nearest, ties up."""
    return rounded(x * 2.0**-shift, exact)


def limited(x: torch.Tensor, low: float, high: float, exact: bool) -> torch.Tensor:
    """`x` clamped; the float model has no clamps but that of a rectifier."""
    if exact:
        return x.clamp(low, high)
    return x.clamp_min(0) if low == 0 else x


def settled(x: torch.Tensor, shift: int, low: float, high: float, exact: bool) -> torch.Tensor:
    """`x` / 2^`shift` to nearest, ties up, and clamped."""
    if exact:
        return cast(torch.Tensor, _Settle.apply(x, 2.0**-shift, low, high))  # type: ignore[no-untyped-call]
    return limited(x * 2.0**-shift, low, high, False)


def sigmoid12(x: torch.Tensor, exact: bool) -> torch.Tensor:
    """4096 / (1 + exp(-x / 32))."""
    if exact:
        return cast(torch.Tensor, _Table.apply(x, _SIGMOID))  # type: ignore[no-untyped-call]
    return SIGMOID_ONE * torch.sigmoid(x / UNIT)


def tanh12(x: torch.Tensor, exact: bool) -> torch.Tensor:
    """2047 * tanh(x / 32)."""
    if exact:
        return cast(torch.Tensor, _Table.apply(x, _TANH))  # type: ignore[no-untyped-call]
    return TANH_ONE * torch.tanh(x / UNIT)


def exp2_weights(differences: torch.Tensor) -> torch.Tensor:
    """round(65536 * 2^(-d / 32)) as SPEC §10.1 has it, of integers d >= 0: int64."""
    d = differences.long()
    table = torch.tensor(EXP2, dtype=torch.int64)
    return torch.where(d > 511, 0, table[d & 31] >> (d >> 5).clamp_max(31))


def frequencies(logits: torch.Tensor) -> torch.Tensor:
    """(n, k) int64 frequencies of integer (n, k) `logits` (SPEC §10.5), each row sums to 2^24."""
    count = logits.shape[1]
    weights = exp2_weights(logits.max(1, keepdim=True).values - logits)
    sums = torch.cumsum(weights, 1)
    cuts = sums * (TOTAL - count) // sums[:, -1:] + torch.arange(1, count + 1)
    return torch.diff(cuts, dim=1, prepend=torch.zeros(len(logits), 1, dtype=torch.int64))


def exact_bits(logits: torch.Tensor, symbols: torch.Tensor) -> torch.Tensor:
    """(n,) float64 bits of `symbols` under the integer frequencies."""
    chosen = frequencies(logits).gather(1, symbols[:, None])[:, 0].double()
    return torch.log2(TOTAL / chosen)
