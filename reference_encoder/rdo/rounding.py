"""Rate-distortion optimised rounding: the cheaper neighbour when the error allows it (encoder side)."""

from __future__ import annotations

from collections import deque

import numpy as np

from reference_encoder.tuning import ROUNDING_ROUNDS
from scarfmt.arrays import F64, I32, I64, Floats
from scarfmt.threads import map_threads

_MOST_VALUES = 1 << 16
"""A column with a wider range is simply rounded: its histogram would say nothing."""


def round_values(values: Floats, weight: F64, classes: I64, lambda_: float, units: F64 | None = None) -> I32:
    """(N, components) int32 integers near `values` / unit that minimise weight * error^2 + lambda_ * bits.

    Candidates are the two nearest integers; bits are those of the value's own histogram in its class,
    re-estimated as choices settle.

    Args:
        values: (N, components).
        weight: (N, components) squared picture error per squared unit of `values`.
        classes: (N,) class numbers.
        lambda_: squared picture error per bit.
        units: (classes, components) quantiser steps; None for 1.
    """
    order = np.argsort(classes, kind="stable")
    edges = np.cumsum([0, *np.bincount(classes)])
    steps = np.ones((len(edges) - 1, values.shape[1])) if units is None else units
    heavy, out = np.broadcast_to(weight, values.shape), np.empty(values.shape, np.int32)

    def fill(component: int) -> None:
        value, weight, column = values[:, component], heavy[:, component], out[:, component]
        for klass, unit in enumerate(steps[:, component]):
            rows = order[edges[klass] : edges[klass + 1]]
            if len(rows):
                column[rows] = _round_class(value[rows] / unit, weight[rows] * unit**2, lambda_)

    deque(map_threads(fill, range(values.shape[1])), 0)
    return out


def _round_class(values: F64, weight: F64, lambda_: float) -> I64:
    """(n,) integers near values of one histogram, at least one."""
    nearest = np.rint(values)
    low, high = nearest.min() - 1, nearest.max() + 1
    if high - low > _MOST_VALUES:
        return nearest.astype(np.int64)
    left = values - nearest
    step = np.where(left >= 0, 1, -1)
    dearer = weight * ((left - step) ** 2 - left**2)
    here = (nearest - low).astype(np.int64)
    chosen = here
    for _ in range(ROUNDING_ROUNDS):
        counts = np.bincount(chosen, minlength=int(high - low) + 1)
        prices = lambda_ * np.log2((len(values) + 1) / (counts + 0.25))
        chosen = here + step * (dearer < prices[here] - prices[here + step])
    return np.asarray(chosen + np.int64(low))
