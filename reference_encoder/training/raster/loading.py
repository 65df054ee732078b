"""The compiled compositing kernel: found, loaded, and what it is given declared (docs/decisions/0034)."""

from __future__ import annotations

import ctypes
import importlib.util
from ctypes import POINTER, byref, c_float, c_int64, c_void_p, sizeof
from functools import cache
from pathlib import Path

from scarfmt.errors import InvalidInput

INTERFACE = 1
"""The number of the interface in composite.c."""
TILE = 16
"""Pixels of a tile, each way."""
GRADIENTS = 9
"""Numbers that the backward pass leaves for an intersection."""


class Job(ctypes.Structure):
    """What a call of the kernel is given: `Job` of composite.c, which says what each is."""

    _fields_ = [
        *[(name, c_int64) for name in ("width", "height", "columns", "tiles")],
        *[(name, c_float) for name in ("max_alpha", "min_alpha", "min_transmittance")],
        ("background", c_float * 3),
        *[(name, c_void_p) for name in ("splats", "offsets", "listed", "owners")],
        *[(name, c_void_p) for name in ("image", "transmittance", "weights", "drawn", "towards", "gradients")],
    ]


_SIGNATURES: dict[str, tuple[type | None, list[type]]] = {
    "scar_composite_interface": (c_int64, []),
    "scar_composite_tile": (c_int64, []),
    "scar_composite_job": (c_int64, []),
    "scar_composite": (None, [POINTER(Job), POINTER(c_int64)]),
    "scar_composite_back": (None, [POINTER(Job), POINTER(c_int64)]),
    "scar_composite_gather": (None, [c_void_p, c_int64, c_void_p, c_int64, c_int64, c_void_p]),
}


@cache
def load() -> ctypes.CDLL:
    """The library with its functions declared.

    Raises:
        InvalidInput: ``input-dependency``: it was not built, or for another machine or version.
    """
    spec = importlib.util.find_spec("reference_encoder.training.raster.native")
    if spec is None or spec.origin is None:
        raise _absent(f"it was not built, {_failure()}")
    try:
        library = ctypes.CDLL(spec.origin)
        for name, (result, arguments) in _SIGNATURES.items():
            function = getattr(library, name)
            function.restype, function.argtypes = result, arguments
    except (OSError, AttributeError) as error:
        raise _absent(f"it was built for another machine or version: {error}") from error
    found = library.scar_composite_interface(), library.scar_composite_tile(), library.scar_composite_job()
    if found != (INTERFACE, TILE, sizeof(Job)):
        raise _absent(f"it was built from another version: {found}, not {(INTERFACE, TILE, sizeof(Job))}")
    return library


def _failure() -> str:
    """Why the build made no library, if it left word of that (setup.py)."""
    try:
        return Path(__file__).with_name("native.failed.txt").read_text().strip()
    except OSError:
        return "perhaps there was no C compiler"


def _absent(why: str) -> InvalidInput:
    advice = "install scarfmt anew where GCC or Clang is found"
    return InvalidInput("input-dependency", f"training on the CPU needs the compiled rasteriser: {why}; {advice}")


def run(name: str, job: Job, counter: c_int64) -> None:
    """Let this thread work on the tiles of `job` that are not taken: `counter` is common to all threads.

    Raises:
        InvalidInput: ``input-dependency``.
    """
    getattr(load(), name)(byref(job), byref(counter))
