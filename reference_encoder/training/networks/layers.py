"""Dense integer layers of the index network, trained through their roundings, and its shape (SPEC §10.1, §10.5).

Tensors are float32 and carry integers: every exact result is below 2^24. Backward, a rounding counts as the identity
and a table as the function it samples: the straight-through estimator.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import torch
from torch import nn

from reference_encoder.training.networks.jit import compile_exact
from reference_encoder.tuning import (
    CODEWORD_DIMS,
    FINE_WEIGHTS_FROM,
    INDICES_OF_EIGHT,
    NARROWEST_HIDDEN,
    WIDEST_HIDDEN,
)
from scarfmt.arrays import F32, F64, Bools
from scarfmt.neural.tables import EXP2, SIGMOID, TANH

ACTIVATION_BITS = 9
TOP = (1 << (ACTIVATION_BITS - 1)) - 1
"""Largest magnitude of an activation."""
_WEIGHT_LIMIT = 127.0
HIDDEN_UNIT = (TOP + 1) / 4
"""One unit of hidden values, that reach from -4 to 4, in integers."""


@dataclass(frozen=True)
class NetworkShape:
    """The shape of an index network.

    Attributes:
        hidden: H, width of embedding, GRU state and attention.
        codeword_dims: R, latent dimensions of a codeword that the network sees.
        gru_layers: G.
        attention: whether states are weighed by the embedding; else the last one is taken.
        weight_bits: about how many bits a weight takes: fixes the step of weights.
    """

    hidden: int = 16
    codeword_dims: int = 12
    gru_layers: int = 1
    attention: bool = False
    weight_bits: int = 6

    @property
    def wide(self) -> int:
        """Y, width between the layers of the embedding and before the heads."""
        return 2 * self.hidden


def shape_for(indices: int, dimension: int, gru_layers: int = 1, attention: bool = False) -> NetworkShape:
    """The network for a scene of so many `indices` (all stages of all anchors) and latent dimensions.

    A network costs its bytes once and saves a share of every index, so the best width grows about with the square root
    of the number of indices.
    """
    width = 8 * float(np.sqrt(max(indices, 1) / INDICES_OF_EIGHT))
    hidden = int(np.clip(2 * round(width / 2), NARROWEST_HIDDEN, WIDEST_HIDDEN))
    weight_bits = 5 if hidden >= FINE_WEIGHTS_FROM else 4
    return NetworkShape(hidden, min(CODEWORD_DIMS, dimension), gru_layers, attention, weight_bits)


_HALF, _NOTHING = np.float32(0.5), np.float32(0)

_TANH = torch.tensor([*(-v for v in reversed(TANH[1:])), *TANH], dtype=torch.float32)
_SIGMOID = torch.tensor([*(4096 - v for v in reversed(SIGMOID[1:])), *SIGMOID], dtype=torch.float32)
_LAST = 255
TANH_ONE, SIGMOID_ONE = 2047.0, 4096.0
UNIT = 32.0
"""Pre-activations are in 32nds, logits in 32nds of a bit."""
TOTAL = 1 << 24
"""Sum of the frequencies of a symbol (SPEC §8.1)."""


@compile_exact
def _shift_and_clamp(x: F32, scale: np.float32, low: np.float32, high: np.float32, out: F32, free: Bools) -> None:
    """Fill `out` with round(x * scale), clamped, and `free` with where the clamp did nothing."""
    for k in range(len(x)):
        value = np.floor(x[k] * scale + _HALF)
        free[k] = (value >= low) & (value <= high)
        out[k] = min(max(value, low), high)


@compile_exact
def _clamped_gradient(grad: F32, free: Bools, scale: np.float32, out: F32) -> None:
    for k in range(len(grad)):
        out[k] = grad[k] * scale if free[k] else _NOTHING


class _ShiftAndClamp(torch.autograd.Function):
    """Rounding shift and clamp in one pass."""

    @staticmethod
    def forward(ctx: Any, x: torch.Tensor, scale: float, low: float, high: float) -> torch.Tensor:
        values = np.ascontiguousarray(x.detach().numpy())
        out, ctx.free, ctx.scale = np.empty_like(values), np.empty(values.shape, np.bool_), np.float32(scale)
        _shift_and_clamp(values.ravel(), ctx.scale, np.float32(low), np.float32(high), out.ravel(), ctx.free.ravel())
        return torch.from_numpy(out)

    @staticmethod
    def backward(ctx: Any, grad: torch.Tensor) -> Any:
        given = np.ascontiguousarray(grad.numpy())
        out = np.empty_like(given)
        _clamped_gradient(given.ravel(), ctx.free.ravel(), ctx.scale, out.ravel())
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


def round_half_up(x: torch.Tensor) -> torch.Tensor:
    """floor(x + 1/2)."""
    return shift_and_clamp(x, 0, -math.inf, math.inf)


def round_shift(x: torch.Tensor, shift: int) -> torch.Tensor:
    """x / 2^shift to nearest, ties up."""
    return round_half_up(x * 2.0**-shift)


def shift_and_clamp(x: torch.Tensor, shift: int, low: float, high: float) -> torch.Tensor:
    """`x` / 2^`shift` to nearest, ties up, and clamped."""
    return cast(torch.Tensor, _ShiftAndClamp.apply(x, 2.0**-shift, low, high))  # type: ignore[no-untyped-call]


def sigmoid12(x: torch.Tensor) -> torch.Tensor:
    """4096 / (1 + exp(-x / 32))."""
    return cast(torch.Tensor, _Table.apply(x, _SIGMOID))  # type: ignore[no-untyped-call]


def tanh12(x: torch.Tensor) -> torch.Tensor:
    """2047 * tanh(x / 32)."""
    return cast(torch.Tensor, _Table.apply(x, _TANH))  # type: ignore[no-untyped-call]


def exp2_weights(differences: torch.Tensor) -> torch.Tensor:
    """round(65536 * 2^(-d / 32)) as SPEC §10.1 has it, of integers d >= 0: int64."""
    d = differences.long()
    table = torch.tensor(EXP2, dtype=torch.int64)
    return torch.where(d > 511, 0, table[d & 31] >> (d >> 5).clamp_max(31))


_BOUND = 1 << 24
MAX_SHIFT = 24


Scale = tuple[F64, F64]
"""(width,) each: what one unit of each input is in integers, and the mean to take off."""


def hidden_scale(width: int) -> Scale:
    """Hidden values as inputs."""
    return np.full(width, HIDDEN_UNIT), np.zeros(width)


def state_scale(width: int) -> Scale:
    """GRU states, from -1 to 1, as inputs."""
    return np.full(width, TOP + 1.0), np.zeros(width)


class Dense(nn.Module):
    """acc = W x + b in integers. W = theta * gain, where `gain` makes theta of order 1 / sqrt(width)."""

    def __init__(
        self,
        scale: Scale,
        rows: int,
        unit: float,
        weight_bits: int,
        generator: torch.Generator,
        *,
        bias: bool = True,
        bound: int = _BOUND,
        start: float = 1.0,
    ) -> None:
        """`rows` outputs of `unit` integers to one; `bound`: SPEC §10.1; `start`: factor of the first weights."""
        super().__init__()
        units, means = scale
        width = len(units)
        spread = 1.0 / np.sqrt(width)
        wanted = 2.0 ** (weight_bits - 1) / 4 / (spread * unit / float(np.exp(np.log(units).mean())))
        self.shift = int(np.clip(round(float(np.log2(wanted))), 0, MAX_SHIFT))
        self._relative = torch.from_numpy((unit / units).astype(np.float32))
        self.gain = self._relative * 2.0**self.shift
        self.means = torch.from_numpy(means.astype(np.float32))
        self._unit, self._bound = unit, bound
        self.biased, self.frozen = bias, False
        self.theta = nn.Parameter(torch.randn(rows, width, generator=generator) * (spread * start))
        self.bias = nn.Parameter(torch.zeros(rows))

    def rescale(self, shift: int) -> None:
        """Take another shift."""
        self.shift = shift
        self.gain = self._relative * 2.0**shift

    def freeze(self) -> None:
        """All zeros, for good."""
        self.frozen = True
        for parameter in (self.theta, self.bias):
            parameter.data.zero_()
            parameter.requires_grad_(False)

    def scale_weights(self) -> torch.Tensor:
        """(rows, width) weights before rounding."""
        return (self.theta * self.gain).clamp(-_WEIGHT_LIMIT, _WEIGHT_LIMIT)

    def integers(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Weights (rows, width) and biases (rows,) as they are used."""
        weights = round_half_up(self._fitting(self.scale_weights()))
        if not self.biased:
            return weights, torch.zeros(len(weights))
        biases = self.bias * (self._unit * 2.0**self.shift) - weights @ self.means
        return weights, round_half_up(biases)

    def _fitting(self, weights: torch.Tensor) -> torch.Tensor:
        """Rows shrunk where they could break the bound of exact sums, which leaves half of it to the bias."""
        most = self._bound / 2 / TOP
        sums = weights.detach().abs().sum(1, keepdim=True) + weights.shape[1]
        return weights * (most / sums).clamp_max(1.0) if bool((sums > most).any()) else weights

    def sums(self, x: torch.Tensor) -> torch.Tensor:
        """(n, rows) W x + b, not yet shifted."""
        weights, biases = self.integers()
        return torch.addmm(biases, x, weights.T)

    def forward(self, x: torch.Tensor, low: float, high: float) -> torch.Tensor:
        """(n, rows) shifted and clamped."""
        return shift_and_clamp(self.sums(x), self.shift, low, high)


def geometric_bits(parts: Sequence[torch.Tensor]) -> torch.Tensor:
    """Bits of integers near the values of each part under the two-sided geometric law of the part's mean magnitude."""
    mean = torch.stack([part.abs().mean() for part in parts]).clamp_min(1e-4)
    ratio = mean / (torch.sqrt(1 + mean * mean) + 1)
    counts = torch.tensor([part.numel() for part in parts])
    return (counts * (torch.log2((1 + ratio) / (1 - ratio)) - mean * torch.log2(ratio))).sum()
