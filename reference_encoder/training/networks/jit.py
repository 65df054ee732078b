"""One place for the options of compiled loops."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

_Function = TypeVar("_Function", bound=Callable[..., Any])


def compile_exact(function: _Function) -> _Function:
    """Compiled for one thread, so that nothing depends on the machine's cores; the GIL is released."""
    return cast(_Function, numba.njit(cache=True, nogil=True, error_model="numpy")(function))


def compile_reduction(function: _Function) -> _Function:
    """Compiled so that LLVM may vectorise sums and maxima of numbers; the order it takes is always the same."""
    fast = {"reassoc", "nnan", "nsz", "contract"}
    return cast(_Function, numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=fast)(function))
