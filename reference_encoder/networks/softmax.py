"""Bits of symbols under a softmax over a range of codewords, compiled, with its gradient.

A row's logits are products of its output vector with the vectors of the codewords it may choose from: all of them,
or those of one cluster. Few rows share a cluster, so torch would gather vectors for every row; here they stay where
they are.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import torch

from reference_encoder.jit import compiled
from reference_encoder.loops import powers, products, summed, top_of
from reference_encoder.networks.integers import TOTAL
from scarfmt.arrays import F32, I64

_ONE = np.float32(1)
_LEAST = np.float32(1 / TOTAL)


@compiled
def _shares(output: F32, vectors: F32, biases: F32, logits: F32, shares: F32) -> None:
    """Fill `shares` (k,) with the probabilities of the symbols; `logits` (k,) is scratch."""
    products(output, vectors, biases, logits)
    top = top_of(logits)
    for k in range(len(logits)):
        logits[k] -= top
    powers(logits, shares)
    scale = _ONE / summed(shares)
    for k in range(len(shares)):
        shares[k] *= scale


@compiled
def _bits(outputs: F32, vectors: F32, biases: F32, ranges: I64, symbols: I64, bits: F32) -> None:
    """Fill `bits` (n,); the arguments are those of `range_bits` in units of a bit, `vectors` (R, k)."""
    logits, shares = np.empty(vectors.shape[1], np.float32), np.empty(vectors.shape[1], np.float32)
    for row in range(len(outputs)):
        first, last = ranges[row, 0], ranges[row, 1]
        size, part = last - first, vectors[:, first:last]
        _shares(outputs[row], part, biases[first:last], logits[:size], shares[:size])
        bits[row] = -np.log2(shares[symbols[row] - first] * (_ONE - size * _LEAST) + _LEAST)


@compiled
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
