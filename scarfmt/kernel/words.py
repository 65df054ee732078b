"""Words of two 16-bit integers, and layers of them, as the compiled library multiplies them (SPEC §10.1)."""

from __future__ import annotations

from typing import Any

import numpy as np

from scarfmt.arrays import I32, Ints
from scarfmt.kernel.structs import Layer
from scarfmt.neural.arithmetic import half_step

UNBOUNDED = 1 << 25
"""No sum reaches it."""


def paired(numbers: Ints) -> I32:
    """(n, m) 16-bit integers as (n, m / 2 rounded up) words: the first of two in the lower half of each."""
    even = np.pad(np.asarray(numbers, np.int64), ((0, 0), (0, numbers.shape[1] % 2)))
    return (even[:, 1::2] << 16 | even[:, ::2] & 0xFFFF).astype(np.uint32).view(np.int32)


class PackedLayers:
    """Layers, and what they and other structs point to."""

    def __init__(self) -> None:
        self._kept: list[Any] = []

    def layer(self, weights: Ints, biases: Ints, shift: int = 0, low: int = -UNBOUNDED, high: int = UNBOUNDED) -> Layer:
        """clamp(round_shift(W x + b, shift)), with rows filled up to be even.

        Args:
            weights: (out, in).
            biases: (out,).
        """
        more = len(weights) % 2
        words = paired(np.pad(weights, ((0, more), (0, 0))))
        rounded = np.pad(np.asarray(biases, np.int64) + half_step(shift), (0, more))
        return Layer(*words.shape, self.words(words), self.words(rounded), shift, low, high)

    def words(self, numbers: Ints) -> int:
        """Address of a copy of these integers, of 32 bits each."""
        self._kept.append(np.ascontiguousarray(numbers, np.int32))
        return int(self._kept[-1].ctypes.data)
