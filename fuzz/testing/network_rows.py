"""Frequency rows of the index network's heads, all at once: what its evaluator gives a block at a time (SPEC §10.5)."""

from __future__ import annotations

from typing import Any

import numpy as np

from scarfmt.arrays import F64
from scarfmt.entropy.rans import TOTAL
from scarfmt.neural.evaluator import Blocks, Evaluator


def first_rows(evaluator: Evaluator, book: int, y: Any) -> F64:
    """(n, k) float64 f - 1 of the codewords of a flat head or the clusters of a two-level one, of (n, Y) `y`."""
    head = evaluator.network.heads[book]
    return _gather(evaluator.first_blocks(book, y), np.empty((len(y), len(head.clusters) or len(head.biases))))


def member_rows(evaluator: Evaluator, book: int, y: Any, cluster: int) -> F64:
    """(n, size) float64 f - 1 of the members of one cluster, of (n, Y) `y` of the anchors that chose it."""
    # Of a cluster of one nothing is coded: all of the frequency is its.
    out = np.full((len(y), evaluator.network.heads[book].clusters[cluster]), TOTAL - 1.0)
    return _gather(evaluator.member_blocks(book, y, np.full(len(y), cluster)), out)


def _gather(blocks: Blocks, out: F64) -> F64:
    for rows, weights in blocks:
        out[rows] = weights
    return out
