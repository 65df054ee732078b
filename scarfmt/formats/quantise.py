"""Conversions that several writers of quantised splat formats share: those of `dequantise`, the other way."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F32, F64, I64, U8, U32


def opacities(logits: F32) -> F64:
    """(N,) float64 opacities 0..1 of (N,) logits of any size."""
    return np.asarray(np.exp(-np.logaddexp(0.0, -logits.astype(np.float64))))


def alpha_of_logit(logits: F32) -> U8:
    """(N,) uint8 opacities, 255 opaque, of (N,) logits."""
    return np.rint(opacities(logits) * 255).astype(np.uint8)


def unit_quaternions(quaternions: F32) -> F64:
    """(N, 4) float64 of length 1; a zero quaternion becomes the identity, as renderers take it."""
    q = quaternions.astype(np.float64)
    largest = np.abs(q).max(axis=1, keepdims=True, initial=0)
    # Divided by the largest first, so that no square over- or underflows.
    q = np.where(largest > 0, q / np.where(largest > 0, largest, 1.0), np.array([1.0, 0, 0, 0]))
    return np.asarray(q / np.linalg.norm(q, axis=1, keepdims=True))


def smallest_three(quaternions: F64) -> tuple[F64, I64]:
    """Unit quaternions without their component of largest magnitude, which is made positive.

    Args:
        quaternions: (N, 4) float64 of length 1, components in the order of the format.

    Returns:
        (N, 3) float64, the other components in their order, each within +-sqrt(1/2); (N,) position of the missing one.
    """
    rows = np.arange(len(quaternions))
    omitted = np.abs(quaternions).argmax(axis=1)
    signed = quaternions * np.where(quaternions[rows, omitted] < 0, -1.0, 1.0)[:, None]
    keep = np.array([[j for j in range(4) if j != i] for i in range(4)])[omitted]
    return signed[rows[:, None], keep], omitted


def levels(fractions: NDArray[np.floating], count: int) -> U32:
    """The nearest of `count` equal steps from 0 to 1, as 0..count - 1."""
    nearest: U32 = np.rint(np.clip(fractions, 0.0, 1.0) * (count - 1)).astype(np.uint32)
    return nearest
