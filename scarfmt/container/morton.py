"""Morton (Z-order) codes of up to 21 bits per axis (SPEC §6.2): x in bit 0, y in bit 1, z in bit 2."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import U64

MAX_BITS = 21

# (shift, mask) pairs that spread 21 bits so that two zero bits follow each.
_SPREAD = (
    (32, 0x001F00000000FFFF),
    (16, 0x001F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)
_GATHERED = (0x10C30C30C30C30C3, 0x100F00F00F00F00F, 0x001F0000FF0000FF, 0x001F00000000FFFF, 0x1FFFFF)
_AXES = np.arange(3, dtype=np.uint64)


def interleave(coordinates: NDArray[np.generic]) -> U64:
    """Morton codes of (N, 3) non-negative integers below 2^21, as (N,) uint64."""
    code = np.zeros(len(coordinates), np.uint64)
    for axis in range(3):
        x = coordinates[:, axis].astype(np.uint64)
        for shift, mask in _SPREAD:
            x = (x | (x << np.uint64(shift))) & np.uint64(mask)
        code |= x << np.uint64(axis)
    return code


def deinterleave(codes: U64) -> U64:
    """(N, 3) uint64 coordinates of (N,) Morton codes: the inverse of :func:`interleave`."""
    x: U64 = (codes[:, None] >> _AXES) & np.uint64(0x1249249249249249)
    for shift, mask in zip((2, 4, 8, 16, 32), _GATHERED, strict=True):
        x |= x >> np.uint64(shift)
        x &= np.uint64(mask)
    return x
