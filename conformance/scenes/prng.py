"""Random numbers that never change: numpy promises no stable streams, SHA-256 of a counter does not change."""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray


class Prng:
    """Integers from SHA-256(seed text, block number), eight bytes each, little-endian."""

    def __init__(self, seed: str) -> None:
        self._seed = seed.encode()
        self._block = 0

    def words(self, count: int) -> NDArray[np.uint64]:
        """(count,) uint64; every call starts a new block."""
        blocks = []
        for _ in range(-(-count // 4)):
            blocks.append(hashlib.sha256(self._seed + b"/" + str(self._block).encode()).digest())
            self._block += 1
        return np.frombuffer(b"".join(blocks), "<u8")[:count].astype(np.uint64)

    def integers(self, low: int, past: int, shape: int | tuple[int, ...]) -> NDArray[np.int64]:
        """int64 in low..past-1, by remainder: the bias does not matter here."""
        count = int(np.prod(shape))
        return (self.words(count) % np.uint64(past - low)).astype(np.int64).reshape(shape) + low

    def draw_peaked(self, spread: int, shape: int | tuple[int, ...]) -> NDArray[np.int64]:
        """int64 round 0, small ones more often: the sum of three uniform ones, each within `spread`."""
        return sum((self.integers(-spread, spread + 1, shape) for _ in range(3)), np.zeros(shape, np.int64))
