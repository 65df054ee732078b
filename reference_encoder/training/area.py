"""Photos made smaller: every new pixel is the mean of the area it covers."""

from __future__ import annotations

import numpy as np

from scarfmt.arrays import F64, U8


def area_filtered(picture: U8, width: int, height: int) -> U8:
    """(height, width, 3) uint8 of a larger picture, rounded to nearest; the picture itself if it has that size.

    Pixels of the old picture that lie across an edge count in part on both sides, so that sizes need not divide.
    """
    if picture.shape[:2] == (height, width):
        return picture
    rows = _averaged(picture.astype(np.float64), height)
    smaller = _averaged(rows.swapaxes(0, 1), width).swapaxes(0, 1)
    return np.asarray(smaller + 0.5, dtype=np.uint8)


def _averaged(values: F64, count: int) -> F64:
    """(count, ...) float64: means of as many equal parts of the first axis."""
    length = len(values)
    sums = np.concatenate([np.zeros_like(values[:1]), np.cumsum(values, axis=0)])
    edges = np.arange(count + 1) * (length / count)
    below = np.minimum(edges.astype(np.intp), length - 1)
    part = (edges - below).reshape(-1, *(1,) * (values.ndim - 1))
    upto = sums[below] + part * values[below]
    means: F64 = np.diff(upto, axis=0) * (count / length)
    return means
