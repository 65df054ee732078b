"""Rate-distortion optimised rounding: the cheaper neighbour when the error allows it (encoder side)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

_ROUNDS = 2


def choose_values(scaled: F64, weight: F64, classes: I64, rate: float) -> I64:
    """(N, components) integers near `scaled` that minimise weight * error^2 + rate * bits.

    Candidates are the two nearest integers; bits are those of the value's own histogram in its class,
    re-estimated as choices settle.

    Args:
        scaled: (N, components) values in units of their quantiser step.
        weight: (N, components) squared picture error per squared step.
        classes: (N,) class numbers.
        rate: lambda.
    """
    nearest = np.rint(scaled).astype(np.int64)
    out = nearest.copy()
    order = np.argsort(classes, kind="stable")
    edges = np.cumsum(np.bincount(classes))[:-1]
    for here in np.split(order, edges):
        for component in range(scaled.shape[1]):
            column = scaled[here, component], nearest[here, component], weight[here, component]
            out[here, component] = _choose_column(*column, rate)
    return out


def _choose_column(x: F64, nearest: I64, weight: F64, rate: float) -> I64:
    """One component of one class."""
    if not len(x):
        return nearest
    other = nearest + np.where(x >= nearest, 1, -1)
    low = int(min(nearest.min(), other.min()))
    if int(max(nearest.max(), other.max())) - low > 1 << 16:
        return nearest
    chosen = nearest
    for _ in range(_ROUNDS):
        counts = np.bincount(chosen - low, minlength=int(max(nearest.max(), other.max())) - low + 1)
        bits = np.log2((len(x) + 1) / (counts + 0.25))
        here = weight * (x - nearest) ** 2 + rate * bits[nearest - low]
        there = weight * (x - other) ** 2 + rate * bits[other - low]
        chosen = np.where(there < here, other, nearest)
    return chosen
