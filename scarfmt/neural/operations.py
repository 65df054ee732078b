"""The few array operations the evaluator is made of, and their NumPy form (SPEC §10.1).

Arrays are binary32 and carry integers, or integers divided by a power of two: every operation here is exact
for the operands a valid network gives it, so another library gives the same values. The names of operations
that change their first operand in place end in ``_``; every operation returns its result.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from scarfmt.rans import TOTAL

Array = Any
F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
Ints = NDArray[np.integer[Any]]
Numbers = NDArray[np.integer[Any] | np.floating[Any]]

_SUMMED_TOGETHER = 64
_TRIANGLE = np.triu(np.ones((_SUMMED_TOGETHER, _SUMMED_TOGETHER), np.float32))


class Operations(Protocol):
    """What an array library has to offer. Arrays index, slice, add and multiply as in NumPy.

    Where a table `exp2` is wanted it is that of :func:`scarfmt.neural.tables.exp2_table`.
    """

    @property
    def chunk(self) -> int:
        """Rows to work on at a time."""

    def constant(self, values: NDArray[Any]) -> Array:
        """`values`, exact in binary32, as an array of the library."""

    def lift(self, x: Numbers, amax: int) -> Array:
        """Integers (n, k), clamped to -amax..amax."""

    def index(self, rows: Ints) -> Array:
        """Row numbers (n,), to be used by :meth:`take`."""

    def empty(self, rows: int, columns: int) -> Array:
        """Memory for (rows, columns)."""

    def take(self, table: Array, rows: Array) -> Array:
        """(n, k) copies of rows of a (t, k) table."""

    def product(self, x: Array, weights: Array) -> Array:
        """(n, out) = (n, in) times (in, out)."""

    def dots(self, a: Array, b: Array) -> Array:
        """(n,) sums of products of the rows of two (n, k)."""

    def floor_(self, x: Array) -> Array:
        """The largest integers not above `x`."""

    def clip_(self, x: Array, low: float, high: float) -> Array:
        """`x` brought into low..high."""

    def lookup_(self, table: Array, x: Array) -> Array:
        """table[i] for the integers i in `x`, brought into the table first. May use up `x`."""

    def shares(self, scores: Array, exp2: Array) -> Array:
        """(t, n) floor(256 w / sum w) with w = exp2w(max - score), of (t, n) integer scores. May use up `scores`."""

    def frequency_rows(self, logits: Array, exp2: Array) -> F64:
        """(n, k) float64 NumPy array f - 1 of (k, n) integer logits (SPEC §8.1, §10.1). May use up `logits`."""


class NumpyOperations:
    """Operations on NumPy arrays in float32; in place, on rows few enough to stay in the cache."""

    chunk = 2048

    def constant(self, values: NDArray[Any]) -> F32:
        return np.ascontiguousarray(values, dtype=np.float32)

    def lift(self, x: Numbers, amax: int) -> F32:
        out = x.astype(np.float32)
        return np.clip(out, -amax, amax, out=out)

    def index(self, rows: Ints) -> NDArray[np.intp]:
        return rows.astype(np.intp, copy=False)

    def empty(self, rows: int, columns: int) -> F32:
        return np.empty((rows, columns), np.float32)

    def take(self, table: F32, rows: NDArray[np.intp]) -> F32:
        return table.take(rows, axis=0)

    def product(self, x: F32, weights: F32) -> F32:
        out: F32 = x @ weights
        return out

    def dots(self, a: F32, b: F32) -> F32:
        out: F32 = np.einsum("ij,ij->i", a, b)
        return out

    def floor_(self, x: F32) -> F32:
        return np.floor(x, out=x)

    def clip_(self, x: F32, low: float, high: float) -> F32:
        return np.clip(x, low, high, out=x)

    def lookup_(self, table: F32, x: F32) -> F32:
        return table.take(x.astype(np.intp), mode="clip")

    def shares(self, scores: F32, exp2: F32) -> F32:
        weights = self.lookup_(exp2, np.subtract(scores.max(axis=0), scores, out=scores)).astype(np.float64)
        totals = weights.sum(axis=0)
        # One division after an exact product: the quotient then rounds to an integer only if it is one.
        weights *= 256
        weights /= totals
        return np.floor(weights, out=weights).astype(np.float32)

    def frequency_rows(self, logits: F32, exp2: F32) -> F64:
        # Distances above 2^24 are not exact, and need not be: from 512 on the weight is 0.
        prefix = _prefix_sums(self.lookup_(exp2, np.subtract(logits.max(axis=0), logits, out=logits)))
        totals = prefix[:, -1:].copy()
        prefix *= TOTAL - prefix.shape[1]
        prefix /= totals
        np.floor(prefix, out=prefix)
        rows = np.empty_like(prefix)
        # One long subtraction, three times faster than one for each row; what it puts in the first column is wrong.
        np.subtract(prefix.ravel()[1:], prefix.ravel()[:-1], out=rows.ravel()[1:])
        rows[:, 0] = prefix[:, 0]
        return rows


def _prefix_sums(weights: F32) -> F64:
    """(n, k) float64 inclusive sums of (k, n) weights up to 2^16, over k.

    By products with a triangle of ones, ten times faster than a running sum; 2^16 * 64 is exact in binary32.
    """
    count = len(weights)
    sums = np.empty((weights.shape[1], count))
    for first in range(0, count, _SUMMED_TOGETHER):
        part = weights[first : first + _SUMMED_TOGETHER]
        sums[:, first : first + len(part)] = part.T @ _TRIANGLE[: len(part), : len(part)]
        if first:
            sums[:, first : first + len(part)] += sums[:, first - 1 : first]
    return sums


NUMPY = NumpyOperations()
