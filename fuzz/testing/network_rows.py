"""Frequency rows of the index network's heads, all at once: what its evaluator gives a block at a time (SPEC §10.5)."""

from __future__ import annotations

from typing import Any

import numpy as np

from scarfmt.arrays import F64
from scarfmt.neural.evaluator import Evaluator


def frequency_rows(evaluator: Evaluator, book: int, y: Any) -> F64:
    """(n, k) float64 f - 1 of the codewords, of (n, Y) `y`, n at least 1."""
    return np.concatenate(list(evaluator.frequency_blocks(book, y)))
