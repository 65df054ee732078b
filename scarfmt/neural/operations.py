"""The few array operations the evaluator is made of (SPEC §10.1).

Arrays are binary32 and carry integers, or integers divided by a power of two: every operation here is exact
for the operands a valid network gives it. The names of operations
that change their first operand in place end in ``_``; every operation returns its result.
"""

from __future__ import annotations

import math
import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F32, F64, Ints, Numbers
from scarfmt.entropy.rans import TOTAL

Array = Any

_SUMMED_TOGETHER = 64
_TRIANGLE = np.triu(np.ones((_SUMMED_TOGETHER, _SUMMED_TOGETHER), np.float32))


class _Scratch(threading.local):
    """Memory of one thread for what is needed within one operation: fresh pages cost more than filling them."""

    def __init__(self) -> None:
        self._arrays: dict[str, NDArray[Any]] = {}

    def array(self, name: str, shape: tuple[int, int], dtype: type) -> NDArray[Any]:
        """An array with anything in it, valid until the next of this name."""
        size = math.prod(shape)
        flat = self._arrays.get(name)
        if flat is None or len(flat) < size:
            flat = self._arrays[name] = np.empty(size, dtype)
        return flat[:size].reshape(shape)


class NumpyOperations:
    """Operations on NumPy arrays in float32; in place, on rows few enough to stay in the cache."""

    chunk = 2048
    elements = 1 << 17

    def __init__(self) -> None:
        self._scratch = _Scratch()

    def constant(self, values: NDArray[Any]) -> F32:
        return np.ascontiguousarray(values, dtype=np.float32)

    def lift(self, x: Numbers, amax: int) -> F32:
        out = x.astype(np.float32)
        return np.clip(out, -amax, amax, out=out)

    def lower(self, x: F32) -> F32:
        return x

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

    def lookup_(self, table: F32, x: F32, origin: int = 0) -> F32:
        np.clip(x, -origin, len(table) - 1 - origin, out=x)
        if origin:
            x += origin
        # By way of int32: four times faster than a conversion to int64 at once.
        short = self._scratch.array("short", x.shape, np.int32)
        np.copyto(short, x, casting="unsafe")
        places = self._scratch.array("places", x.shape, np.intp)
        np.copyto(places, short)
        # All are within the table; "wrap" is the fastest way not to check it.
        return table.take(places, mode="wrap", out=x)

    def shares(self, scores: F32, exp2: F32) -> F32:
        weights = self.lookup_(exp2, np.subtract(scores.max(axis=0), scores, out=scores)).astype(np.float64)
        totals = weights.sum(axis=0)
        # One division after an exact product: the quotient then rounds to an integer only if it is one.
        weights *= 256
        weights /= totals
        return np.floor(weights, out=weights).astype(np.float32)

    def frequency_rows(self, logits: F32, exp2: F32) -> F64:
        # Distances above 2^24 are not exact, and need not be: from 512 on the weight is 0.
        prefix = self._prefix_sums(self.lookup_(exp2, np.subtract(logits.max(axis=0), logits, out=logits)))
        totals = prefix[:, -1:].copy()
        prefix *= TOTAL - prefix.shape[1]
        prefix /= totals
        np.floor(prefix, out=prefix)
        rows = np.empty_like(prefix)
        # One long subtraction, three times faster than one for each row; what it puts in the first column is wrong.
        np.subtract(prefix.ravel()[1:], prefix.ravel()[:-1], out=rows.ravel()[1:])
        rows[:, 0] = prefix[:, 0]
        return rows

    def _prefix_sums(self, weights: F32) -> F64:
        """(n, k) float64 inclusive sums of (k, n) weights up to 2^16, over k; valid until the next.

        By products with a triangle of ones, ten times faster than a running sum; 2^16 * 64 is exact in binary32.
        """
        count, wide = weights.shape
        sums = self._scratch.array("sums", (wide, count), np.float64)
        for first in range(0, count, _SUMMED_TOGETHER):
            part = weights[first : first + _SUMMED_TOGETHER]
            size = len(part)
            block = self._scratch.array("block", (wide, size), np.float32)
            np.matmul(part.T, _TRIANGLE[:size, :size], out=block)
            before = sums[:, first - 1 : first] if first else 0.0
            np.add(block, before, out=sums[:, first : first + size])
        return sums


NUMPY = NumpyOperations()
