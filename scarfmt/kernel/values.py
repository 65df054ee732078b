"""Compiled channel values (SPEC §9.2)."""

from __future__ import annotations

import ctypes

import numpy as np

from scarfmt.arrays import F32, F64, I32, I64
from scarfmt.kernel.memory import address, shaped


def kernel_values(library: ctypes.CDLL, values: I32, steps: I64, widths: F64, out: F32 | None = None) -> F32:
    """(n, components) float32 values of (n, components) `values` at (n,) `steps`, rows of (steps, components) `widths`.

    Args:
        out: where to put them; None for an array of their own.

    Raises:
        IndexError: a step has no row.
        TypeError: arrays of another type or shape.
    """
    if values.ndim != 2 or steps.shape != values.shape[:1] or widths.shape[1:] != values.shape[1:]:
        raise TypeError(f"values {values.shape}, steps {steps.shape} and widths {widths.shape} do not fit")
    if len(steps) and not 0 <= int(steps.min()) <= int(steps.max()) < len(widths):
        raise IndexError(f"steps beyond 0..{len(widths) - 1}")
    made, apart = np.empty(values.shape, np.float32) if out is None else out, planes(values)
    arrays = len(values), address(steps, np.int64), address(widths, np.float64)
    library.scar_values(address(apart, np.int32), *arrays, *values.shape, shaped(made, np.float32, values.shape))
    return made


def planes(values: I32) -> I32:
    """(components, n) of (n, components) `values`, in one piece: what lies so already is not copied."""
    return np.ascontiguousarray(values.T)
