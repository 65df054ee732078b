"""Other ways to do the evaluator's operations: in float64 or int64, in random orders, counting extremes."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F32, F64, I64, Floats
from scarfmt.neural.arithmetic import ACCUMULATOR_LIMIT
from scarfmt.neural.operations import NumpyOperations
from scarfmt.neural.tables import EXP2_LAST, LAST


class DoubleOperations(NumpyOperations):
    """Everything in binary64, which holds all of these sums whether or not binary32 does."""

    def constant(self, values: NDArray[Any]) -> Any:
        return np.ascontiguousarray(values, dtype=np.float64)

    def lift(self, x: NDArray[Any], amax: int) -> Any:
        return np.clip(x.astype(np.float64), -amax, amax)

    def empty(self, rows: int, columns: int) -> Any:
        return np.empty((rows, columns))


class ShuffledOperations(NumpyOperations):
    """Binary32, one product after the other added in random order, after a random split into two partial sums."""

    def __init__(self, seed: int) -> None:
        super().__init__()
        self._rng = np.random.default_rng(seed)

    def product(self, x: F32, weights: F32) -> F32:
        sums = np.zeros((2, len(x), weights.shape[1]), np.float32)
        for column in self._rng.permutation(len(weights)):
            sums[self._rng.integers(2)] += x[:, column, None] * weights[column]
        out: F32 = sums[0] + sums[1]
        return out

    def dots(self, a: F32, b: F32) -> F32:
        out = np.zeros(len(a), np.float32)
        for column in self._rng.permutation(a.shape[1]):
            out += a[:, column] * b[:, column]
        return out


class PermutedOperations(NumpyOperations):
    """Binary32 by the library's own products, of rows and columns in random order, and of batches of random size.

    Whole files are decoded with it: many times faster than :class:`ShuffledOperations`, and batches of anchors meet
    the library's blocks in another order at every product.
    """

    def __init__(self, seed: int) -> None:
        super().__init__()
        self._rng = np.random.default_rng(seed)
        self.chunk = int(self._rng.integers(1, 3000))
        self.elements = 1 << int(self._rng.integers(10, 20))

    def product(self, x: F32, weights: F32) -> F32:
        rows, columns = self._rng.permutation(len(x)), self._rng.permutation(len(weights))
        out = np.empty((len(x), weights.shape[1]), np.float32)
        out[rows] = x[np.ix_(rows, columns)] @ weights[columns]
        return out

    def dots(self, a: F32, b: F32) -> F32:
        columns = self._rng.permutation(a.shape[1])
        return super().dots(a[:, columns], b[:, columns])

    def shares(self, scores: F32, exp2: F32) -> F32:
        anchors = self._rng.permutation(scores.shape[1])
        out = np.empty_like(scores)
        out[:, anchors] = super().shares(scores[:, anchors], exp2)
        return out

    def frequency_rows(self, logits: F32, exp2: F32) -> F64:
        anchors = self._rng.permutation(logits.shape[1])
        found = super().frequency_rows(logits[:, anchors], exp2)
        out = np.empty_like(found)
        out[anchors] = found
        return out


class IntegerOperations(NumpyOperations):
    """Products in int64, which rounds nothing: of operands scaled up until they are whole."""

    def product(self, x: F32, weights: F32) -> F32:
        return self._whole(x, weights, np.matmul)

    def dots(self, a: F32, b: F32) -> F32:
        return self._whole(a, b, lambda left, right: (left * right).sum(axis=1))

    @staticmethod
    def _whole(a: F32, b: F32, act: Callable[[I64, I64], I64]) -> F32:
        # In binary64 from here on: the units of both are powers of two.
        wide, units = (a.astype(np.float64), b.astype(np.float64)), (_unit(a), _unit(b))
        left, right = ((values / unit).astype(np.int64) for values, unit in zip(wide, units, strict=True))
        out: F32 = (act(left, right) * (units[0] * units[1])).astype(np.float32)
        return out


class CountingOperations(DoubleOperations):
    """In binary64, keeping the largest value of each kind, in units of its last binary digit.

    Weights carry the shift of their layer as a power of two; an array's unit is the least it needs. So a value here is
    what has to fit the 24 bits of binary32.
    """

    def __init__(self) -> None:
        super().__init__()
        self._largest: defaultdict[str, float] = defaultdict(float)
        self._sums: Any = None
        self._lookups: defaultdict[str, list[int]] = defaultdict(lambda: [0, 0])

    def _keep(self, what: str, values: Floats, unit: float) -> None:
        if values.size:
            self._largest[what] = max(self._largest[what], float(np.abs(values).max()) / unit)

    def product(self, x: Any, weights: Any) -> Any:
        # Of magnitudes: no partial sum is larger, whatever the order.
        self._keep("sum of the magnitudes of products", np.abs(x) @ np.abs(weights), _unit(x) * _unit(weights))
        self._sums = super().product(x, weights)
        return self._sums

    def dots(self, a: Any, b: Any) -> Any:
        self._keep("score of attention, before its shift", (np.abs(a) * np.abs(b)).sum(axis=1), 1)
        return super().dots(a, b)

    def floor_(self, x: Any) -> Any:
        # Others are no accumulators: fractions in them that do not fit beside large numbers decide nothing.
        if x is self._sums:
            self._keep("accumulator with bias and half step", x, _unit(x))
            self._sums = None
        return super().floor_(x)

    def lookup_(self, table: Any, x: Any, origin: int = 0) -> Any:
        last = EXP2_LAST if origin == 0 else LAST
        name = "distance of a logit or score" if origin == 0 else "argument of sigmoid or tanh"
        self._keep(name, x, 1)
        figures = self._lookups[name]
        figures[0] += x.size
        figures[1] += int(np.count_nonzero(np.abs(x) > last))
        return super().lookup_(table, x, origin)

    def report(self) -> list[dict[str, str]]:
        """What, the largest seen, and its limit, for tables."""
        out = []
        for what, largest in sorted(self._largest.items()):
            if what in self._lookups:
                count, beyond = self._lookups[what]
                limit = f"table ends at {EXP2_LAST if 'distance' in what else LAST}: {beyond / count:.1%} lie beyond"
            else:
                limit = f"below {ACCUMULATOR_LIMIT:,}: {largest / ACCUMULATOR_LIMIT:.1%} of it"
            out.append({"what": what, "seen": f"{largest:,.0f}", "limit": limit})
        return out


def _unit(values: Floats) -> float:
    """The largest power of two, 1 at most, of which all `values` are multiples."""
    unit = 1.0
    while bool((values != np.floor(values)).any()):
        values, unit = values * 2, unit / 2
    return unit
