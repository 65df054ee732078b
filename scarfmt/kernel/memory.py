"""Checks of what is passed to the compiled library: arrays of the right type, and a bounded number of symbols."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from scarfmt.arrays import F32
from scarfmt.errors import LimitExceeded

MOST_SYMBOLS = (1 << 31) - 1
"""Maximum symbols in one call: their places are 32-bit numbers. Tiles need at most 2^26, 64 components of 2^20
anchors."""
_LINE = 64
"""Bytes of a line of the cache."""


def address(array: NDArray[Any], dtype: DTypeLike) -> int:
    """Address of the numbers of an array. The library relies on their type and order, and changes some arrays in place.

    Raises:
        TypeError: they are not of `dtype`, or not in one piece in C order.
    """
    if array.dtype != dtype or not array.flags.c_contiguous:
        raise TypeError(f"{array.dtype} of strides {array.strides}, not {np.dtype(dtype)} in C order")
    return int(array.ctypes.data)


def shaped(array: NDArray[Any], dtype: DTypeLike, shape: tuple[int, ...]) -> int:
    """:func:`address` of an array of a given shape.

    Raises:
        TypeError: it has another shape, type or order.
    """
    if array.shape != shape:
        raise TypeError(f"an array of shape {array.shape}, not {shape}")
    return address(array, dtype)


def at_lines(array: F32) -> F32:
    """A copy that begins where a line of the cache does: a vector of its width is read from one line."""
    room = np.empty(array.nbytes + _LINE, np.uint8)
    start = -room.ctypes.data % _LINE
    copy = room[start : start + array.nbytes].view(np.float32).reshape(array.shape)
    copy[...] = array
    return copy


def check_symbols(count: int) -> None:
    """Check that one call may read so many symbols.

    Raises:
        LimitExceeded: ``limit-tile-anchors``.
    """
    if count > MOST_SYMBOLS:
        raise LimitExceeded("limit-tile-anchors", f"{count} symbols at once: decode with --backend numpy")
