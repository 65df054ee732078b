"""Integer arithmetic of the networks: tables, rounding, linear layers (SPEC §10.1), in Python integers.

A vector is a list of int, a matrix a list of rows. Nothing here is fast.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from conformance.decoders.python.fields import require
from conformance.decoders.python.numbers import Numbers

Vector = list[int]
Matrix = list[Vector]

# No entry comes within 0.0004 of a half: the printed tables and every machine's formulas agree (tests compare them).
TANH = [round(2047 * math.tanh(u / 32)) for u in range(256)]
SIGMOID = [round(4096 / (1 + math.exp(-u / 32))) for u in range(256)]
EXP2 = [round(65536 * 2 ** (-f / 32)) for f in range(32)]


def round_shift(v: int, s: int) -> int:
    return (v + (1 << s >> 1)) >> s


def clamp(v: int, low: int, high: int) -> int:
    return min(max(v, low), high)


def tanh12(u: int) -> int:
    t = TANH[min(abs(u), 255)]
    return t if u >= 0 else -t


def sigmoid12(u: int) -> int:
    t = SIGMOID[min(abs(u), 255)]
    return t if u >= 0 else 4096 - t


def exp2w(d: int) -> int:
    return 0 if d > 511 else EXP2[d % 32] >> (d // 32)


def dot(a: Sequence[int], b: Sequence[int]) -> int:
    return sum(x * y for x, y in zip(a, b, strict=True))


def product(matrix: Matrix, x: Vector, biases: Vector) -> Vector:
    return [dot(row, x) + b for row, b in zip(matrix, biases, strict=True)]


class Linear(NamedTuple):
    """A linear layer."""

    weights: Matrix
    biases: Vector
    shift: int

    def is_exact(self, amax: int) -> bool:
        """Whether it keeps R-10.1-1 with activations of this magnitude; its weights do where they were read."""
        if not (self.weights and self.weights[0] and self.shift <= 24):
            return False
        reach = (amax * sum(map(abs, row)) + abs(b) for row, b in zip(self.weights, self.biases, strict=True))
        return max(reach) + (1 << self.shift >> 1) < 1 << 24

    def round(self, x: Vector) -> Vector:
        return [round_shift(v, self.shift) for v in product(self.weights, x, self.biases)]

    def __call__(self, x: Vector, low: int, high: int) -> Vector:
        return [clamp(v, low, high) for v in self.round(x)]


def read_matrix(numbers: Numbers, rows: int, columns: int, field: str, refusal: str) -> Matrix:
    """A matrix of a block, row by row, its weights within reach (R-10.1-1)."""
    weights = numbers.signed(rows * columns, field)
    require(all(abs(w) <= 32767 for w in weights), refusal)
    return [weights[r * columns : (r + 1) * columns] for r in range(rows)]
