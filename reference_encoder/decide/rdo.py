"""Rate-distortion optimised rounding: the cheaper neighbour when the error allows it (encoder side)."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from reference_encoder.tuning import ROUNDING_ROUNDS
from scarfmt.arrays import F64, I64


def choose_values(scaled: F64, weight: F64, classes: I64, lambda_: float) -> I64:
    """(N, components) integers near `scaled` that minimise weight * error^2 + lambda_ * bits.

    Candidates are the two nearest integers; bits are those of the value's own histogram in its class,
    re-estimated as choices settle.

    Args:
        scaled: (N, components) values in units of their quantiser step.
        weight: (N, components) squared picture error per squared step.
        classes: (N,) class numbers.
        lambda_: squared picture error per bit.
    """
    order = np.argsort(classes, kind="stable")
    edges = np.cumsum([0, *np.bincount(classes)])
    # Values of a class and component side by side.
    values, weights = (np.ascontiguousarray(each[order].T) for each in (scaled, np.broadcast_to(weight, scaled.shape)))
    chosen = np.empty(values.shape, np.int64)
    for first, last in pairwise(edges):
        for column, x, heavy in zip(chosen, values, weights, strict=True):
            column[first:last] = _choose_column(x[first:last], heavy[first:last], lambda_)
    out = np.empty(scaled.shape, np.int64)
    out[order] = chosen.T
    return out


def _choose_column(x: F64, weight: F64, lambda_: float) -> I64:
    """One component of one class."""
    nearest = np.rint(x).astype(np.int64)
    if not len(x):
        return nearest
    other = nearest + np.where(x >= nearest, 1, -1)
    low = int(min(nearest.min(), other.min()))
    if int(max(nearest.max(), other.max())) - low > 1 << 16:
        return nearest
    chosen = nearest
    for _ in range(ROUNDING_ROUNDS):
        counts = np.bincount(chosen - low, minlength=int(max(nearest.max(), other.max())) - low + 1)
        bits = np.log2((len(x) + 1) / (counts + 0.25))
        here = weight * (x - nearest) ** 2 + lambda_ * bits[nearest - low]
        there = weight * (x - other) ** 2 + lambda_ * bits[other - low]
        chosen = np.where(there < here, other, nearest)
    return chosen
