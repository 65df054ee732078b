"""One place for numba's options, so that every kernel is compiled, cached and typed alike."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

_Function = TypeVar("_Function", bound=Callable[..., Any])


def kernel(function: _Function) -> _Function:
    """Compile `function` with its `numba.prange` loops on all threads.

    No fast-math: reassociated sums would make pictures depend on the machine. numba renews its cache when the
    file of the function changes, not that of an imported constant: delete `__pycache__` after editing one.
    """
    return cast(_Function, numba.njit(cache=True, parallel=True, error_model="numpy")(function))


def device(function: _Function) -> _Function:
    """Compile a single-threaded helper, callable from kernels and from Python."""
    return cast(_Function, numba.njit(cache=True, error_model="numpy")(function))
