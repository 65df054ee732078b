"""Heads of the index network: from the mixed context to the probabilities of a codeword (SPEC §10.5).

A codeword's logit is its product with a vector the network aims at, plus a bias; so a head costs one small matrix
and a bias a codeword. Two-level: first the cluster, by its centroid, then the codeword in it, by what sets it apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np
import torch
from torch import nn

from reference_encoder.networks.integers import UNIT, exact_bits, round_shift, rounded
from reference_encoder.networks.layers import Dense, Scale
from reference_encoder.networks.shape import NetworkShape
from reference_encoder.networks.softmax import range_bits
from reference_encoder.tuning import LOGIT_REACH_BITS
from scarfmt.arrays import I64

BIAS_STEP = 8
"""Biases of logits are whole quarters of a bit."""
_NEVER = -1e6


class _Level(nn.Module):
    """One softmax: logits (<v_j, o> + beta_j) >> shift over vectors v_j, with o = W y."""

    vectors: torch.Tensor
    scaled: torch.Tensor

    def __init__(self, shape: NetworkShape, vectors: I64, generator: torch.Generator) -> None:
        super().__init__()
        dims, value = vectors.shape[1], Scale.hidden(shape, shape.mixer)
        self.top = shape.top
        self.project = Dense(value, dims, value.unit, shape, generator, start=0.3)
        length = max(float(np.sqrt((vectors.astype(np.float64) ** 2).sum(axis=1).mean())), 1.0)
        self.shift = int(np.clip(round(float(np.log2(length * value.unit / (UNIT * LOGIT_REACH_BITS)))), 0, 20))
        self.register_buffer("vectors", torch.from_numpy(vectors.astype(np.float32)))
        self.scale = 2.0**-self.shift / UNIT
        self.register_buffer("scaled", (self.vectors.T * self.scale).contiguous())
        self.beta = nn.Parameter(torch.zeros(len(vectors)))
        bound = int(np.abs(vectors).sum(axis=1).max(initial=0)) * shape.top + (64 * 32 << self.shift)
        assert bound < 1 << 24, "codewords leave no room for exact logits"

    def outputs(self, y: torch.Tensor, exact: bool) -> torch.Tensor:
        """(n, R) vectors aimed at."""
        out: torch.Tensor = self.project(y, exact, -self.top, self.top)
        return out

    def biases(self, exact: bool) -> torch.Tensor:
        """(k,) beta before the shift."""
        return rounded(self.beta * (UNIT / BIAS_STEP), exact).clamp(-160, 160) * float(BIAS_STEP << self.shift)

    def bits(self, y: torch.Tensor, exact: bool, ranges: torch.Tensor, symbols: torch.Tensor) -> torch.Tensor:
        """(n,) bits of `symbols` among those in `ranges` (n, 2), but for the rounding of logits and frequencies."""
        return range_bits(self.outputs(y, exact), self.biases(exact) * self.scale, self.scaled, ranges, symbols)


class HeadModel(nn.Module):
    """A flat or two-level head over one codebook."""

    centroids: torch.Tensor
    cluster_of: torch.Tensor
    place: torch.Tensor
    members: torch.Tensor
    ranges: torch.Tensor
    alone: torch.Tensor

    def __init__(self, shape: NetworkShape, words: I64, sizes: Sequence[int], generator: torch.Generator) -> None:
        super().__init__()
        self.sizes = tuple(sizes)
        self.count = len(words)
        if not sizes:
            self.levels = nn.ModuleList([_Level(shape, words, generator)])
            return
        cluster_of = np.repeat(np.arange(len(sizes)), sizes)
        starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
        centroids = np.add.reduceat(words, starts, axis=0) // np.array(sizes)[:, None]
        apart = words - centroids[cluster_of]
        self.levels = nn.ModuleList([_Level(shape, centroids, generator), _Level(shape, apart, generator)])
        slots = np.arange(max(sizes))
        members = np.where(slots < np.array(sizes)[:, None], starts[:, None] + slots, self.count)
        self.register_buffer("cluster_of", torch.from_numpy(cluster_of))
        self.register_buffer("place", torch.from_numpy(np.arange(self.count) - starts[cluster_of]))
        self.register_buffer("members", torch.from_numpy(members))
        self.register_buffer("ranges", torch.from_numpy(np.stack([starts, starts + np.array(sizes)], axis=1)))
        self.register_buffer("alone", torch.from_numpy(np.array(sizes) == 1))

    def level(self, number: int) -> _Level:
        """The softmax over all codewords or clusters (0), or over the members of a cluster (1)."""
        return cast(_Level, self.levels[number])

    def start_from(self, uses: I64) -> None:
        """Set the biases to the logarithms of (n,) `uses`."""
        counts = torch.from_numpy(uses.astype(np.float32)) + 0.3
        if not self.sizes:
            self.level(0).beta.data = torch.log2(counts / counts.max())
            return
        sums = torch.zeros(len(self.sizes)).index_add_(0, self.cluster_of, counts)
        tops = torch.stack([part.max() for part in torch.split(counts, list(self.sizes))])
        self.level(0).beta.data = torch.log2(sums / sums.max())
        self.level(1).beta.data = torch.log2(counts / tops[self.cluster_of])

    def logits(self, y: torch.Tensor, exact: bool, strict: bool = False) -> torch.Tensor:
        """(n, codewords or clusters) first-level logits in 32nds of a bit; rounded if `strict`."""
        level = self.level(0)
        sums = torch.addmm(level.biases(exact), level.outputs(y, exact), level.vectors.T)
        return round_shift(sums, level.shift, strict)

    def member_logits(self, y: torch.Tensor, cluster: torch.Tensor, exact: bool, strict: bool = False) -> torch.Tensor:
        """(n, most members) logits in the given clusters, very low where there is no member."""
        level = self.level(1)
        slots = self.members[cluster]
        there = slots < self.count
        slots = slots.clamp_max(self.count - 1)
        products = torch.bmm(level.vectors[slots], level.outputs(y, exact)[:, :, None])[:, :, 0]
        logits = round_shift(products + level.biases(exact)[slots], level.shift, strict)
        return torch.where(there, logits, _NEVER)

    def bits(self, y: torch.Tensor, codes: torch.Tensor, exact: bool) -> torch.Tensor:
        """(n,) bits of `codes`, but for the rounding of logits and frequencies."""
        if not self.sizes:
            return self.level(0).bits(y, exact, torch.tensor([[0, self.count]]).expand(len(y), 2), codes)
        cluster = self.cluster_of[codes]
        first = self.level(0).bits(y, exact, torch.tensor([[0, len(self.sizes)]]).expand(len(y), 2), cluster)
        more = torch.nonzero(~self.alone[cluster])[:, 0]
        second = self.level(1).bits(y[more], exact, self.ranges[cluster[more]], codes[more])
        return first.index_add(0, more, second)

    def exact_bits(self, y: torch.Tensor, codes: torch.Tensor) -> torch.Tensor:
        """(n,) float64 bits of `codes` under the integer frequencies."""
        if not self.sizes:
            return exact_bits(self.logits(y, True, True), codes)
        cluster = self.cluster_of[codes]
        out = exact_bits(self.logits(y, True, True), cluster)
        for number, size in enumerate(self.sizes):
            here = torch.nonzero(cluster == number)[:, 0]
            if size > 1 and len(here):
                logits = self.member_logits(y[here], cluster[here], True, True)[:, :size]
                out[here] += exact_bits(logits, self.place[codes[here]])
        return out

    def bias_steps(self) -> list[torch.Tensor]:
        """Biases as they are coded: as differences, of each level."""
        return [torch.diff(cast(_Level, level).beta) * (UNIT / BIAS_STEP) for level in self.levels]
