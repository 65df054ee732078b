"""Heads of the index network: from the mixed context to the probabilities of a codeword (SPEC §10.5).

A codeword's logit is its product with a vector the network aims at, plus a bias; so a head costs one small matrix and a
bias a codeword.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import nn

from reference_encoder.training.networks.layers import (
    HIDDEN_UNIT,
    TOP,
    TOTAL,
    UNIT,
    Dense,
    NetworkShape,
    hidden_scale,
    round_half_up,
)
from reference_encoder.tuning import LOGIT_REACH_BITS
from scarfmt.arrays import I64

BIAS_STEP = 8
"""Biases of logits are whole quarters of a bit."""


class HeadModel(nn.Module):
    """A softmax over one codebook: logits (<e_j, o> + beta_j) >> shift over codewords e_j, with o = W y."""

    def __init__(self, shape: NetworkShape, words: I64, generator: torch.Generator) -> None:
        super().__init__()
        dims, inputs = words.shape[1], hidden_scale(shape.wide)
        self.project = Dense(inputs, dims, HIDDEN_UNIT, shape.weight_bits, generator, start=0.3)
        length = max(float(np.sqrt((words.astype(np.float64) ** 2).sum(axis=1).mean())), 1.0)
        self.shift = int(np.clip(round(float(np.log2(length * HIDDEN_UNIT / (UNIT * LOGIT_REACH_BITS)))), 0, 20))
        self.scale = 2.0**-self.shift / UNIT
        self.words = torch.from_numpy(words.astype(np.float32)).T * self.scale
        self.beta = nn.Parameter(torch.zeros(len(words)))
        bound = int(np.abs(words).sum(axis=1).max(initial=0)) * TOP + (64 * 32 << self.shift)
        assert bound < 1 << 24, "codewords leave no room for exact logits"

    def biases(self) -> torch.Tensor:
        """(k,) beta before the shift."""
        return round_half_up(self.beta * (UNIT / BIAS_STEP)).clamp(-160, 160) * float(BIAS_STEP << self.shift)

    def start_from(self, uses: I64) -> None:
        """Set the biases to the logarithms of (n,) `uses`."""
        counts = torch.from_numpy(uses.astype(np.float32)) + 0.3
        self.beta.data = torch.log2(counts / counts.max())

    def bits(self, y: torch.Tensor, codes: torch.Tensor) -> torch.Tensor:
        """(n,) bits of `codes`, no probability below 2^-24, but for the rounding of logits and frequencies."""
        logits = torch.addmm(self.biases() * self.scale, self.project(y, -TOP, TOP), self.words)
        chosen = torch.softmax(logits * math.log(2), 1).gather(1, codes[:, None])[:, 0]
        return -torch.log2(chosen * (1 - len(self.beta) / TOTAL) + 1 / TOTAL)

    def bias_steps(self) -> torch.Tensor:
        """Biases as they are coded: as differences."""
        return torch.diff(self.beta) * (UNIT / BIAS_STEP)
