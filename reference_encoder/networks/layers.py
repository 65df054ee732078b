"""Dense integer layers of the index network, trained through their roundings (SPEC §10.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from reference_encoder.networks.integers import rounded, settled
from reference_encoder.networks.shape import NetworkShape
from scarfmt.arrays import F64

_BOUND = 1 << 24
MAX_SHIFT = 24


def whole(values: F64) -> F64:
    """Nearest integers, ties up."""
    return np.asarray(np.floor(values + 0.5))


@dataclass(frozen=True)
class Scale:
    """(width,) what one unit of each input is in integers, and the mean to take off."""

    units: F64
    means: F64

    @property
    def unit(self) -> float:
        """The unit of the first input."""
        return float(self.units[0])

    @classmethod
    def inputs(cls, means: F64, spreads: F64) -> Scale:
        """Inputs of known mean and spread."""
        return cls(spreads, means)

    @classmethod
    def codewords(cls, words: NDArray[Any]) -> Scale:
        """(n, R) codewords as inputs."""
        return cls(np.maximum(words.std(axis=0), 2.0), np.zeros(words.shape[1]))

    @classmethod
    def hidden(cls, shape: NetworkShape, width: int) -> Scale:
        """Hidden values, that reach from -4 to 4."""
        return cls(np.full(width, (shape.top + 1) / 4), np.zeros(width))

    @classmethod
    def state(cls, activation_bits: int, width: int) -> Scale:
        """GRU states, from -1 to 1."""
        return cls(np.full(width, float(1 << (activation_bits - 1))), np.zeros(width))

    @classmethod
    def joined(cls, first: Scale, second: Scale) -> Scale:
        """The scales of two inputs, joined side by side."""
        return cls(np.concatenate([first.units, second.units]), np.concatenate([first.means, second.means]))


class Dense(nn.Module):
    """acc = W x + b in integers. W = theta * gain, where `gain` makes theta of order 1 / sqrt(width)."""

    gain: torch.Tensor
    means: torch.Tensor

    def __init__(
        self,
        scale: Scale,
        rows: int,
        unit: float,
        shape: NetworkShape,
        generator: torch.Generator,
        *,
        bias: bool = True,
        bound: int = _BOUND,
        start: float = 1.0,
    ) -> None:
        """`rows` outputs of `unit` integers to one; `bound`: SPEC §10.1; `start`: factor of the first weights."""
        super().__init__()
        width = len(scale.units)
        spread = 1.0 / np.sqrt(width)
        wanted = 2.0 ** (shape.weight_bits - 1) / 4 / (spread * unit / float(np.exp(np.log(scale.units).mean())))
        self.shift = int(np.clip(round(float(np.log2(wanted))), 0, MAX_SHIFT))
        self._relative = torch.from_numpy((unit / scale.units).astype(np.float32))
        self.register_buffer("gain", self._relative * 2.0**self.shift)
        self.register_buffer("means", torch.from_numpy(scale.means.astype(np.float32)))
        self._unit, self._limit, self._top, self._bound = unit, float(shape.weight_limit), shape.top, bound
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

    def scaled(self) -> torch.Tensor:
        """(rows, width) weights before rounding."""
        return (self.theta * self.gain).clamp(-self._limit, self._limit)

    def integers(self, exact: bool) -> tuple[torch.Tensor, torch.Tensor]:
        """Weights (rows, width) and biases (rows,) as they are used."""
        weights = rounded(self._fitting(self.scaled()), True) if exact else self.theta * self.gain
        if not self.biased:
            return weights, torch.zeros(len(weights))
        biases = self.bias * (self._unit * 2.0**self.shift) - weights @ self.means
        return weights, rounded(biases, exact)

    def _fitting(self, weights: torch.Tensor) -> torch.Tensor:
        """Rows shrunk where they could break the bound of exact sums, which leaves half of it to the bias."""
        most = self._bound / 2 / self._top
        sums = weights.detach().abs().sum(1, keepdim=True) + weights.shape[1]
        return weights * (most / sums).clamp_max(1.0) if bool((sums > most).any()) else weights

    def sums(self, x: torch.Tensor, exact: bool) -> torch.Tensor:
        """(n, rows) W x + b, not yet shifted."""
        weights, biases = self.integers(exact)
        return torch.addmm(biases, x, weights.T)

    def forward(self, x: torch.Tensor, exact: bool, low: float, high: float) -> torch.Tensor:
        """(n, rows) shifted and clamped."""
        return settled(self.sums(x, exact), self.shift, low, high, exact)


def geometric_bits(parts: Sequence[torch.Tensor]) -> torch.Tensor:
    """Bits of integers near the values of each part under the two-sided geometric law of the part's mean magnitude."""
    mean = torch.stack([part.abs().mean() for part in parts]).clamp_min(1e-4)
    ratio = mean / (torch.sqrt(1 + mean * mean) + 1)
    counts = torch.tensor([part.numel() for part in parts])
    return (counts * (torch.log2((1 + ratio) / (1 - ratio)) - mean * torch.log2(ratio))).sum()
