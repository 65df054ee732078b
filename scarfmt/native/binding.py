"""The compiled library: found, loaded, and its functions declared as in ``scar.h``."""

from __future__ import annotations

import ctypes
import importlib.util
import os
from ctypes import POINTER, c_char_p, c_double, c_int32, c_int64, c_uint32, c_void_p
from functools import cache
from pathlib import Path

INTERFACE = 10
"""The number of the interface in ``scar.h``."""
Signatures = dict[str, tuple[type | None, list[type]]]
"""Of functions: type of the result, and of the arguments."""


class SceneRows(ctypes.Structure):
    """Addresses of the rows of a scene that a tile's Gaussians go to."""

    _fields_ = tuple((name, c_void_p) for name in ("positions", "log_scales", "quaternions", "logits", "harmonics"))


class SideBySide(ctypes.Structure):
    """Static tables as ``write.c`` has them."""

    _fields_ = (("count", c_int64), *((name, c_void_p) for name in ("keys", "values", "starts", "sums")))


_SIGNATURES: Signatures = {
    "scar_interface": (c_int32, []),
    "scar_open": (c_void_p, [*[c_int32] * 4, *[c_double] * 5]),
    "scar_share": (c_void_p, [c_void_p]),
    "scar_close": (None, [c_void_p]),
    "scar_block": (c_int32, [c_void_p, c_int32, c_int32, c_char_p, c_int32]),
    "scar_models": (c_int32, [c_void_p, c_int32, c_int32]),
    "scar_tile": (c_void_p, [c_void_p, c_int32, c_int32, c_uint32, c_uint32]),
    "scar_advance": (c_void_p, [c_void_p, c_void_p, c_char_p, c_int32, c_int32, c_int32]),
    "scar_release": (None, [c_void_p]),
    "scar_tile_count": (c_int32, [c_void_p]),
    "scar_values": (c_void_p, [c_void_p, c_void_p, c_int32, c_int32]),
    "scar_scene": (c_int32, [c_void_p, c_void_p, POINTER(SceneRows)]),
    "scar_model_number": (c_int32, [c_void_p, c_int32, c_int32]),
    "scar_work": (c_double, [c_void_p, c_void_p, c_int64, c_int64]),
    "scar_refusal": (c_char_p, [c_void_p]),
    "scar_steps": (None, [c_void_p, c_int64, c_void_p, c_void_p, c_int64, c_int64, c_void_p, c_void_p]),
    "scar_count": (c_int64, [c_void_p, c_int64, *[c_void_p] * 3, c_int64, *[POINTER(c_int64)] * 2]),
    "scar_code": (c_int64, [POINTER(SideBySide), c_void_p, c_int64, *[c_void_p] * 4]),
}


class Absent(Exception):
    """No compiled library can be used; the message gives the reason."""


@cache
def absence() -> str | None:
    """Why this process does not use the compiled library; None where it does.

    ``SCARFMT_NATIVE=0`` in the environment, read once, leaves it unused.
    """
    if os.environ.get("SCARFMT_NATIVE") == "0":
        return "it is turned off by SCARFMT_NATIVE=0"
    try:
        load()
    except Absent as error:
        return str(error)
    return None


def library() -> ctypes.CDLL | None:
    """The library; None where it is absent."""
    return load() if absence() is None else None


def describe() -> str:
    """The decoder of this process by name, and why it is not the faster one."""
    return "native" if absence() is None else f"numpy (no native library: {absence()})"


@cache
def load() -> ctypes.CDLL:
    """The library with its functions declared.

    Raises:
        Absent: it was not built, or for another machine or version.
    """
    found = open_library(find_library("scarfmt.native", Path(__file__).parent), _SIGNATURES)
    if found.scar_interface() != INTERFACE:
        raise Absent(f"it was built from another version: interface {found.scar_interface()}, not {INTERFACE}")
    return found


def find_library(package: str, folder: Path) -> str:
    """The file of the compiled library of a package, which is in `folder`.

    Raises:
        Absent: it was not built.
    """
    spec = importlib.util.find_spec(f"{package}.native")
    if spec is not None and spec.origin is not None:
        return spec.origin
    try:
        why = (folder / "native.failed.txt").read_text().strip()  # left by a build that failed (setup.py)
    except OSError:
        why = "perhaps there was no C compiler when scarfmt was installed"
    raise Absent(f"it was not built: {why}")


def open_library(path: str, signatures: Signatures) -> ctypes.CDLL:
    """The library in a file with these functions declared.

    Raises:
        Absent: it cannot be loaded, or lacks one of them.
    """
    try:
        found = ctypes.CDLL(path)
    except OSError as error:
        raise Absent(f"it cannot be loaded, perhaps it was built for another machine: {error}") from error
    try:
        for name, (result, arguments) in signatures.items():
            function = getattr(found, name)
            function.restype, function.argtypes = result, arguments
    except AttributeError as error:
        raise Absent("it was built from another version: a function is missing") from error
    return found
