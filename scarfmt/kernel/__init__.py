"""Optional compiled inner loops of the decoder. Without them the same integers come from NumPy and constriction.

The library is built when the package is installed and a C compiler is found; nothing fails without one. It is called
through ctypes, which lets other threads run meanwhile. ``SCARFMT_KERNEL=0`` in the environment leaves it unused.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Iterator
from contextlib import contextmanager

from scarfmt.kernel.interface import load

_unwanted = 0


def available() -> bool:
    """Whether the compiled library is there."""
    return load() is not None


def functions() -> ctypes.CDLL | None:
    """The compiled library, None where it is not there or not wanted."""
    if _unwanted or os.environ.get("SCARFMT_KERNEL") == "0":
        return None
    return load()


def enabled() -> bool:
    """Whether decoding uses the compiled library."""
    return functions() is not None


@contextmanager
def disabled() -> Iterator[None]:
    """Decode without the compiled library meanwhile, in all threads."""
    global _unwanted
    _unwanted += 1
    try:
        yield
    finally:
        _unwanted -= 1
