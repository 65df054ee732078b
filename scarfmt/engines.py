"""The choice of the engine that computes: the compiled kernel if there is one, else NumPy (docs/decisions/0016).

Nothing is imported to say which it is; the engines are when one is asked for.
"""

from __future__ import annotations

import os
from functools import cache
from typing import TYPE_CHECKING

from scarfmt.errors import InvalidInput
from scarfmt.kernel.loading import Absent, load

if TYPE_CHECKING:
    from collections.abc import Callable

    from scarfmt.arrays import F32, I64
    from scarfmt.coding.engine import Engine
    from scarfmt.neural.operations import Operations

NAMES = ("auto", "kernel", "numpy")
"""The names that :func:`engine_named` accepts."""


@cache
def absence() -> str | None:
    """Why this process does not use the compiled kernel; None where it does.

    ``SCARFMT_KERNEL=0`` in the environment, read once, leaves it unused.
    """
    if os.environ.get("SCARFMT_KERNEL") == "0":
        return "it is turned off by SCARFMT_KERNEL=0"
    try:
        load()
    except Absent as error:
        return str(error)
    return None


def described() -> str:
    """The best engine of this process by name, and why it is not a faster one."""
    return "kernel" if absence() is None else f"numpy (no kernel: {absence()})"


@cache
def best_engine() -> Engine:
    """The fastest engine there is: what every reader and writer is given unless somebody asks for another."""
    return engine_named("auto")


def engine_named(name: str, operations: Operations | None = None) -> Engine:
    """An engine by name.

    Args:
        name: one of `NAMES`; "auto" is the best there is.
        operations: array arithmetic of the index network, where the engine does not do it itself; None for NumPy's.

    Raises:
        InvalidInput: ``input-backend`` for another name, or "kernel" where there is none to use.
    """
    from scarfmt.coding.engine import NumpyEngine
    from scarfmt.kernel.engine import KernelEngine
    from scarfmt.neural.operations import NUMPY

    if name not in NAMES:
        raise InvalidInput("input-backend", f"{name!r} is not one of {', '.join(NAMES)}", field="backend")
    if name == "kernel" and absence() is not None:
        raise InvalidInput("input-backend", f"no compiled kernel: {absence()}", field="backend")
    if name == "numpy" or absence() is not None:
        return NumpyEngine(operations or NUMPY)
    return KernelEngine(load(), operations or NUMPY)


def codeword_search(words: F32, half: F32, prices: F32) -> Callable[[F32, F32, I64, I64], None] | None:
    """The compiled search for codewords, :meth:`scarfmt.kernel.codewords.KernelCodewords.fill`; None without a kernel.

    Args:
        words, half, prices: as of :class:`scarfmt.kernel.codewords.KernelCodewords`.
    """
    if absence() is not None:
        return None
    from scarfmt.kernel.codewords import KernelCodewords

    return KernelCodewords(load(), words, half, prices).fill
