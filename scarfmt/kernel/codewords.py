"""Compiled search for codewords: the codes that the encoder's own loop chooses (reference_encoder/latent/rvq.py)."""

from __future__ import annotations

import ctypes

import numpy as np

from scarfmt.arrays import F32, I64
from scarfmt.kernel import structs
from scarfmt.kernel.memory import address, at_lines, shaped

TOGETHER = 64
"""Codewords that codewords.c scores together."""


class KernelCodewords:
    """A codebook and prices, to be searched by any number of threads.

    Args:
        library: the compiled library.
        words: (d, k) float32 negated codewords.
        half: (k,) float32 half of their squared lengths.
        prices: (classes, k) float32 of each codeword in each class.
    """

    def __init__(self, library: ctypes.CDLL, words: F32, half: F32, prices: F32) -> None:
        self._library, self._dimension, self._classes = library, len(words), len(prices)
        beyond = -len(half) % TOGETHER
        # Of infinite length: no vector is nearest to them.
        self._half = at_lines(np.pad(half, (0, beyond), constant_values=np.inf))
        self._words, self._prices = (at_lines(np.pad(rows, ((0, 0), (0, beyond)))) for rows in (words, prices))
        self._struct = structs.Codewords(
            len(self._half), len(words), address(self._words, np.float32), address(self._half, np.float32)
        )

    def fill(self, x: F32, weight: F32, classes: I64, out: I64) -> None:
        """Fill `out` (n,) with codes of least weight * (half + x @ words) + price, the first of equals.

        Args:
            x: (n, d) float32 finite vectors.
            weight: (n,) float32 finite, from 0.
            classes: (n,) int64.

        Raises:
            IndexError: a class has no prices.
            TypeError: arrays of another type or shape.
        """
        count = len(out)
        arrays = shaped(x, np.float32, (count, self._dimension)), shaped(weight, np.float32, (count,))
        chosen = shaped(classes, np.int64, (count,)), address(self._prices, np.float32)
        if count and not 0 <= int(classes.min()) <= int(classes.max()) < self._classes:
            raise IndexError(f"classes beyond 0..{self._classes - 1}")
        target = shaped(out, np.int64, (count,))
        self._library.scar_codewords(ctypes.byref(self._struct), *arrays, *chosen, count, target)
