"""Which engine computes: the compiled kernel where there is one, or NumPy (docs/decisions/0016)."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cache

from scarfmt.coding.engine import Engine, NumpyEngine
from scarfmt.errors import InvalidInput
from scarfmt.kernel.engine import KernelEngine
from scarfmt.kernel.library import Absent, load
from scarfmt.neural.operations import NUMPY, Operations

NAMES = ("auto", "kernel", "numpy")
"""What :func:`engine_named` takes."""


@dataclass(frozen=True)
class Choice:
    """An engine, and why it is not a faster one.

    Attributes:
        engine: what computes.
        absence: why the compiled kernel does not, None where it does.
    """

    engine: Engine
    absence: str | None

    def __str__(self) -> str:
        return self.engine.name if self.absence is None else f"{self.engine.name} (no kernel: {self.absence})"


@cache
def choice() -> Choice:
    """The best engine of this process. ``SCARFMT_KERNEL=0`` in the environment, read once, leaves the kernel unused."""
    if os.environ.get("SCARFMT_KERNEL") == "0":
        return Choice(NumpyEngine(), "it is turned off by SCARFMT_KERNEL=0")
    try:
        return Choice(KernelEngine(load()), None)
    except Absent as error:
        return Choice(NumpyEngine(), str(error))


def best_engine() -> Engine:
    """The fastest engine there is: what every reader and writer is given unless somebody asks for another."""
    return choice().engine


def engine_named(name: str, operations: Operations = NUMPY) -> Engine:
    """An engine by name.

    Args:
        name: one of `NAMES`; "auto" is the best there is.
        operations: array arithmetic of the index network, where the engine does not do it itself.

    Raises:
        InvalidInput: ``input-backend`` for another name, or "kernel" where there is none to use.
    """
    if name not in NAMES:
        raise InvalidInput("input-backend", f"{name!r} is not one of {', '.join(NAMES)}", field="backend")
    found = choice()
    if name == "kernel" and found.absence is not None:
        raise InvalidInput("input-backend", f"no compiled kernel: {found.absence}", field="backend")
    if name == "numpy" or found.absence is not None:
        return NumpyEngine(operations)
    return found.engine if operations is NUMPY else KernelEngine(load(), operations)
