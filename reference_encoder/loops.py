"""Small compiled loops over codewords, shared by searches and trainings."""

from __future__ import annotations

from typing import Any

import numpy as np

from reference_encoder.jit import compiled, reduced
from scarfmt.arrays import F32

_SQUARINGS = 8
_STEP = np.float32(np.log(2) / 2**_SQUARINGS)
_LOWEST = np.float32(-32.0)
_ONE, _HALF, _SIXTH = np.float32(1), np.float32(1 / 2), np.float32(1 / 6)


@compiled
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


@compiled
def add_products(output: F32, vectors: F32, out: F32) -> None:
    """Add products of `output` (R,) and `vectors` (R, k) to `out` (k,), four at a time: stores are what costs.

    Every operation is rounded by itself, as in scarfmt/kernel/codewords.c.
    """
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


@compiled
def products(output: F32, vectors: F32, biases: F32, out: F32) -> None:
    """Fill `out` (k,) with products of `output` (R,) and `vectors` (R, k), plus `biases` (k,)."""
    for k in range(len(out)):
        out[k] = biases[k]
    add_products(output, vectors, out)


@reduced
def top_of(values: F32) -> Any:
    """The largest of some values, none of which is NaN."""
    top = values[0]
    for k in range(len(values)):
        top = max(top, values[k])
    return top


@reduced
def summed(values: F32) -> Any:
    """The sum of the values."""
    total = np.float32(0)
    for k in range(len(values)):
        total += values[k]
    return total


@reduced
def least_of(values: F32) -> Any:
    """The smallest of some values, none of which is NaN."""
    least = values[0]
    for k in range(len(values)):
        least = min(least, values[k])
    return least


@compiled
def first_of_least(values: F32) -> int:
    """The index of the first smallest value."""
    least = least_of(values)
    for k in range(len(values)):
        if values[k] == least:
            return k
    return 0
