"""Memory that the compiled library works in, kept from call to call: fresh pages cost more than filling them."""

from __future__ import annotations

import math
import threading
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray


class Scratch(threading.local):
    """The working memory of one thread. It grows to what the largest call needs."""

    def __init__(self) -> None:
        self._held: dict[str, tuple[NDArray[np.uint8], int]] = {}

    def at(self, name: str, size: int) -> int:
        """Address of `size` bytes with any content, valid until the next call with this name."""
        held = self._held.get(name)
        if held is None or len(held[0]) < size:
            fresh = np.empty(size + size // 8 + 64, np.uint8)
            held = self._held[name] = fresh, int(fresh.ctypes.data)
        return held[1]

    def array(self, name: str, shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
        """An array in the memory of this name: the same validity."""
        size = math.prod(shape) * np.dtype(dtype).itemsize
        self.at(name, size)
        return self._held[name][0][:size].view(dtype).reshape(shape)


SCRATCH = Scratch()
