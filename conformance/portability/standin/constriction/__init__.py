"""The part of the package ``constriction`` that scarfmt uses, for machines without a build of it: SPEC §8.2 in Python.

A model is its weights, frequencies minus 1; a family of models has None, and gets them with the symbols, a row each.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

_PRECISION, _TOTAL, _LOWER = 24, 1 << 24, 1 << 32

Numbers = NDArray[Any]


class _Categorical:
    def __init__(self, probabilities: Numbers | None = None, *, perfect: bool) -> None:
        self.weights = probabilities


class _AnsCoder:
    def __init__(self, words: Numbers) -> None:
        self._words, self._state = [int(word) for word in words], 0
        for _ in range(2):
            self._refill()

    def _refill(self) -> None:
        if self._state < _LOWER and self._words:
            self._state = self._state << 32 | self._words.pop()

    def decode(self, model: _Categorical, what: Any) -> Numbers:
        """The next symbols: `what` of them by one model, or one for each row of weights."""
        if model.weights is None:
            return np.array([self._symbol(_cumulative(row)) for row in what], np.int32)
        cumulative = _cumulative(model.weights)
        return np.array([self._symbol(cumulative) for _ in range(what)], np.int32)

    def _symbol(self, cumulative: NDArray[np.int64]) -> int:
        slot = self._state & _TOTAL - 1
        symbol = int(np.searchsorted(cumulative, slot, side="right")) - 1
        start, past = int(cumulative[symbol]), int(cumulative[symbol + 1])
        self._state = (past - start) * (self._state >> _PRECISION) + slot - start
        self._refill()
        return symbol

    def is_empty(self) -> bool:
        """Whether everything has been taken out."""
        return not self._state and not self._words


def _cumulative(weights: Numbers) -> NDArray[np.int64]:
    return np.concatenate([[0], np.cumsum(weights.astype(np.int64) + 1)])


stream = SimpleNamespace(stack=SimpleNamespace(AnsCoder=_AnsCoder), model=SimpleNamespace(Categorical=_Categorical))
