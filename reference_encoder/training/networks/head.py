"""Heads of the index network: from the mixed context to the probabilities of a codeword (SPEC §10.5).

A codeword's logit is its product with a vector the network aims at, plus a bias; so a head costs one small matrix and a
bias a codeword. Two-level: first the cluster, by its centroid, then the codeword in it, by what sets it apart.

Bits of symbols are compiled, with their gradient: few rows share a cluster, so torch would gather vectors for every
row; here they stay where they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
import torch
from torch import nn

from reference_encoder.training.networks.jit import compile_exact, compile_reduction
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
from scarfmt.arrays import F32, I64

_SQUARINGS = 8
_STEP = np.float32(np.log(2) / 2**_SQUARINGS)
_LOWEST = np.float32(-32.0)
_ONE, _HALF, _SIXTH = np.float32(1), np.float32(1 / 2), np.float32(1 / 6)
_LEAST = np.float32(1 / TOTAL)


@compile_exact
def powers(exponents: F32, out: F32) -> None:
    """2^x of exponents x <= 0, to about 1e-5; 2^-32 below. Written out, because a call would stop vectorisation."""
    for k in range(len(out)):
        t = max(exponents[k], _LOWEST) * _STEP
        value = _ONE + t * (_ONE + t * (_HALF + t * _SIXTH))
        value *= value
        value *= value
        value *= value
        value *= value
        value *= value
        value *= value
        value *= value
        value *= value
        out[k] = value


@compile_exact
def add_products(output: F32, vectors: F32, out: F32) -> None:
    """Add products of `output` (R,) and `vectors` (R, k) to `out` (k,), four at a time: stores are what costs."""
    whole = len(output) // 4 * 4
    for row in range(0, whole, 4):
        one, two, three, four = output[row], output[row + 1], output[row + 2], output[row + 3]
        a, b, c, d = vectors[row], vectors[row + 1], vectors[row + 2], vectors[row + 3]
        for k in range(len(out)):
            out[k] += one * a[k] + two * b[k] + (three * c[k] + four * d[k])
    for row in range(whole, len(output)):
        factor, source = output[row], vectors[row]
        for k in range(len(out)):
            out[k] += factor * source[k]


@compile_exact
def products(output: F32, vectors: F32, biases: F32, out: F32) -> None:
    """Fill `out` (k,) with products of `output` (R,) and `vectors` (R, k), plus `biases` (k,)."""
    for k in range(len(out)):
        out[k] = biases[k]
    add_products(output, vectors, out)


@compile_reduction
def top_of(values: F32) -> Any:
    """The largest of some values, none of which is NaN."""
    top = values[0]
    for k in range(len(values)):
        top = max(top, values[k])
    return top


@compile_reduction
def sum_values(values: F32) -> Any:
    """The sum of the values."""
    total = np.float32(0)
    for k in range(len(values)):
        total += values[k]
    return total


@compile_exact
def _shares(output: F32, vectors: F32, biases: F32, logits: F32, shares: F32) -> None:
    """Fill `shares` (k,) with the probabilities of the symbols; `logits` (k,) is scratch."""
    products(output, vectors, biases, logits)
    top = top_of(logits)
    for k in range(len(logits)):
        logits[k] -= top
    powers(logits, shares)
    scale = _ONE / sum_values(shares)
    for k in range(len(shares)):
        shares[k] *= scale


@compile_exact
def _bits(outputs: F32, vectors: F32, biases: F32, ranges: I64, symbols: I64, bits: F32) -> None:
    """Fill `bits` (n,); the arguments are those of `range_bits` in units of a bit, `vectors` (R, k)."""
    logits, shares = np.empty(vectors.shape[1], np.float32), np.empty(vectors.shape[1], np.float32)
    for row in range(len(outputs)):
        first, last = ranges[row, 0], ranges[row, 1]
        size, part = last - first, vectors[:, first:last]
        _shares(outputs[row], part, biases[first:last], logits[:size], shares[:size])
        bits[row] = -np.log2(shares[symbols[row] - first] * (_ONE - size * _LEAST) + _LEAST)


@compile_exact
def _gradients(
    outputs: F32,
    vectors: F32,
    rows: F32,
    biases: F32,
    ranges: I64,
    symbols: I64,
    by_bits: F32,
    by_outputs: F32,
    by_biases: F32,
) -> None:
    """Fill `by_outputs` (n, R), add to `by_biases` (k,), given the gradient `by_bits` (n,); `rows`: (k, R) vectors."""
    logits, shares = np.empty(vectors.shape[1], np.float32), np.empty(vectors.shape[1], np.float32)
    for row in range(len(outputs)):
        first, last = ranges[row, 0], ranges[row, 1]
        size, part, own = last - first, vectors[:, first:last], symbols[row] - first
        _shares(outputs[row], part, biases[first:last], logits[:size], shares[:size])
        most = _ONE - size * _LEAST
        factor = by_bits[row] * shares[own] * most / (shares[own] * most + _LEAST)
        shares[own] -= _ONE
        into, total = by_outputs[row], by_biases[first:last]
        into[:] = 0
        for k in range(size):
            slope, source = factor * shares[k], rows[first + k]
            total[k] += slope
            for place in range(len(into)):
                into[place] += slope * source[place]


class _RangeBits(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any,
        outputs: torch.Tensor,
        biases: torch.Tensor,
        vectors: torch.Tensor,
        ranges: torch.Tensor,
        symbols: torch.Tensor,
    ) -> torch.Tensor:
        ctx.save_for_backward(outputs, biases, vectors, ranges, symbols)
        bits = np.empty(len(outputs), np.float32)
        _bits(_array(outputs), _array(vectors), _array(biases), _array(ranges), _array(symbols), bits)
        return torch.from_numpy(bits)

    @staticmethod
    def backward(ctx: Any, by_bits: torch.Tensor) -> Any:
        outputs, biases, vectors, ranges, symbols = (_array(part) for part in ctx.saved_tensors)
        by_outputs, by_biases = np.empty_like(outputs), np.zeros_like(biases)
        rows, given = np.ascontiguousarray(vectors.T), _array(by_bits)
        _gradients(outputs, vectors, rows, biases, ranges, symbols, given, by_outputs, by_biases)
        return torch.from_numpy(by_outputs), torch.from_numpy(by_biases), None, None, None


def range_bits(
    outputs: torch.Tensor, biases: torch.Tensor, vectors: torch.Tensor, ranges: torch.Tensor, symbols: torch.Tensor
) -> torch.Tensor:
    """(n,) bits of symbols, no probability below 2^-24, with gradients by `outputs` and `biases`.

    Args:
        outputs: (n, R) what each row aims at.
        biases: (k,) of all symbols' logits, in bits.
        vectors: (R, k) of all symbols; a logit is the product with an output plus the bias, in bits.
        ranges: (n, 2) int64 symbols each row chooses from: a first and the one after the last.
        symbols: (n,) int64 those it takes.
    """
    return cast(torch.Tensor, _RangeBits.apply(outputs, biases, vectors, ranges, symbols))  # type: ignore[no-untyped-call]


def _array(tensor: torch.Tensor) -> Any:
    return np.ascontiguousarray(tensor.detach().numpy())


BIAS_STEP = 8
"""Biases of logits are whole quarters of a bit."""


class _Level(nn.Module):
    """One softmax: logits (<v_j, o> + beta_j) >> shift over vectors v_j, with o = W y."""

    def __init__(self, shape: NetworkShape, vectors: I64, generator: torch.Generator) -> None:
        super().__init__()
        dims, inputs = vectors.shape[1], hidden_scale(shape.wide)
        self.project = Dense(inputs, dims, HIDDEN_UNIT, shape.weight_bits, generator, start=0.3)
        length = max(float(np.sqrt((vectors.astype(np.float64) ** 2).sum(axis=1).mean())), 1.0)
        self.shift = int(np.clip(round(float(np.log2(length * HIDDEN_UNIT / (UNIT * LOGIT_REACH_BITS)))), 0, 20))
        self.vectors, self.scale = torch.from_numpy(vectors.astype(np.float32)), 2.0**-self.shift / UNIT
        self.scaled = (self.vectors.T * self.scale).contiguous()
        self.beta = nn.Parameter(torch.zeros(len(vectors)))
        bound = int(np.abs(vectors).sum(axis=1).max(initial=0)) * TOP + (64 * 32 << self.shift)
        assert bound < 1 << 24, "codewords leave no room for exact logits"

    def outputs(self, y: torch.Tensor) -> torch.Tensor:
        """(n, R) vectors aimed at."""
        out: torch.Tensor = self.project(y, -TOP, TOP)
        return out

    def biases(self) -> torch.Tensor:
        """(k,) beta before the shift."""
        return round_half_up(self.beta * (UNIT / BIAS_STEP)).clamp(-160, 160) * float(BIAS_STEP << self.shift)

    def bits(self, y: torch.Tensor, ranges: torch.Tensor, symbols: torch.Tensor) -> torch.Tensor:
        """(n,) bits of `symbols` among those in `ranges` (n, 2), but for the rounding of logits and frequencies."""
        return range_bits(self.outputs(y), self.biases() * self.scale, self.scaled, ranges, symbols)


class HeadModel(nn.Module):
    """A flat or two-level head over one codebook: a softmax over all codewords, or over clusters and over the members
    of a cluster."""

    def __init__(self, shape: NetworkShape, words: I64, sizes: Sequence[int], generator: torch.Generator) -> None:
        super().__init__()
        self.sizes, self.count = tuple(sizes), len(words)
        parts = [words]
        if sizes:
            cluster_of, ends = np.repeat(np.arange(len(sizes)), sizes), np.cumsum(np.array(sizes, np.int64))
            starts = ends - sizes
            centroids = np.add.reduceat(words, starts, axis=0) // np.array(sizes)[:, None]
            parts = [centroids, words - centroids[cluster_of]]
            self.cluster_of = torch.from_numpy(cluster_of)
            self.ranges = torch.from_numpy(np.stack([starts, ends], axis=1))
        self.level = [_Level(shape, part, generator) for part in parts]
        self.levels = nn.ModuleList(self.level)

    def start_from(self, uses: I64) -> None:
        """Set the biases to the logarithms of (n,) `uses`."""
        counts = torch.from_numpy(uses.astype(np.float32)) + 0.3
        if not self.sizes:
            self.level[0].beta.data = torch.log2(counts / counts.max())
            return
        sums = torch.zeros(len(self.sizes)).index_add_(0, self.cluster_of, counts)
        tops = torch.stack([part.max() for part in torch.split(counts, list(self.sizes))])
        self.level[0].beta.data = torch.log2(sums / sums.max())
        self.level[1].beta.data = torch.log2(counts / tops[self.cluster_of])

    def bits(self, y: torch.Tensor, codes: torch.Tensor) -> torch.Tensor:
        """(n,) bits of `codes`, but for the rounding of logits and frequencies."""
        symbols = self.cluster_of[codes] if self.sizes else codes
        every = torch.tensor([[0, len(self.sizes) or self.count]]).expand(len(y), 2)
        first = self.level[0].bits(y, every, symbols)
        if not self.sizes:
            return first
        ranges = self.ranges[symbols]
        more = torch.nonzero(ranges.diff()[:, 0] > 1)[:, 0]
        return first.index_add(0, more, self.level[1].bits(y[more], ranges[more], codes[more]))

    def bias_steps(self) -> list[torch.Tensor]:
        """Biases as they are coded: as differences, of each level."""
        return [torch.diff(level.beta) * (UNIT / BIAS_STEP) for level in self.level]
