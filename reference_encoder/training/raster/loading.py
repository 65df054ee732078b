"""The compiled rasteriser: found, loaded, and what it is given declared (docs/decisions/0034)."""

from __future__ import annotations

import ctypes
import importlib.util
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from ctypes import POINTER, c_double, c_float, c_int64, c_void_p, sizeof
from functools import cache
from pathlib import Path

import torch
from torch import Tensor

from scarfmt.errors import InvalidInput

INTERFACE = 2
"""The number of the interface in composite.c."""
TILE = 16
"""Pixels of a tile, each way."""
GRADIENTS = 9
"""Numbers that the backward pass leaves for an intersection."""
ELLIPSE, SPLAT = 6, 12
"""Floats of an `Ellipse` and of a `Splat` of raster.h."""


class Scene(ctypes.Structure):
    """M Gaussians: `Scene` of raster.h."""

    _fields_ = [(name, c_void_p) for name in ("centres", "scales", "rotations", "opacities", "colours")]


class Lens(ctypes.Structure):
    """A camera: `Lens` of raster.h."""

    _fields_ = [
        ("pose", c_double * 12),
        *[(name, c_float) for name in ("fx", "fy", "cx", "cy", "width", "height", "near", "dilation")],
        *[(name, c_float) for name in ("limit_x", "limit_y", "widest", "min_alpha")],
    ]


class Job(ctypes.Structure):
    """The arguments of compositing: `Job` of composite.h, which describes each."""

    _fields_ = [
        *[(name, c_int64) for name in ("width", "height", "columns", "tiles")],
        *[(name, c_float) for name in ("max_alpha", "min_alpha", "min_transmittance")],
        ("background", c_float * 3),
        *[(name, c_void_p) for name in ("splats", "offsets", "listed", "owners")],
        *[(name, c_void_p) for name in ("image", "transmittance", "weights", "drawn", "towards", "gradients")],
    ]


_SPLATS = 4 * SPLAT
_SIGNATURES: dict[str, tuple[type | None, list[type]]] = {
    "scar_composite_interface": (c_int64, []),
    "scar_composite_tile": (c_int64, []),
    "scar_composite_structs": (c_int64, []),
    "scar_composite": (None, [POINTER(Job), POINTER(c_int64)]),
    "scar_composite_back": (None, [POINTER(Job), POINTER(c_int64)]),
    "scar_composite_weights": (None, [*[c_void_p] * 3, c_int64, c_int64, c_void_p]),
    "scar_composite_gather": (None, [*[c_void_p] * 4, c_int64, c_int64, *[c_void_p] * 4]),
    "scar_project": (None, [POINTER(Scene), POINTER(Lens), c_int64, c_int64, *[c_void_p] * 3]),
    "scar_project_back": (None, [POINTER(Scene), POINTER(Lens), c_int64, c_int64, *[c_void_p] * 6]),
    "scar_nearest_first": (c_int64, [c_void_p, c_int64, *[c_void_p] * 3]),
    "scar_arrange": (None, [POINTER(Scene), c_void_p, c_int64, c_int64, *[c_void_p] * 3]),
    "scar_count_tiles": (None, [c_void_p, c_int64, c_int64, c_int64, *[c_void_p] * 3]),
    "scar_list_tiles": (None, [c_void_p, c_int64, c_int64, *[c_void_p] * 3]),
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
    expected = INTERFACE, TILE, sizeof(Job) + sizeof(Lens) + sizeof(Scene) + _SPLATS
    found = library.scar_composite_interface(), library.scar_composite_tile(), library.scar_composite_structs()
    if found != expected:
        raise _absent(f"it was built from another version: {found}, not {expected}")
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


def pointer(tensor: Tensor, dtype: torch.dtype = torch.float32) -> int:
    """Address of the numbers of a tensor.

    Raises:
        TypeError: they are of another type than `dtype`, not in one piece, or on another device.
    """
    if tensor.dtype != dtype or not tensor.is_contiguous() or tensor.device.type != "cpu":
        raise TypeError(f"{tensor.dtype} of strides {tensor.stride()} on {tensor.device}, not {dtype} in C order")
    return tensor.data_ptr()


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, "raster")


def on_threads(work: Callable[[int, int], None], count: int) -> None:
    """Call `work` with (first, past) of shares of `count` things on as many threads as torch uses, with this one."""
    threads = torch.get_num_threads()
    shares = [(count * thread // threads, count * (thread + 1) // threads) for thread in range(threads)]
    others = [_pool(threads - 1).submit(work, *share) for share in shares[1:]]
    work(*shares[0])
    for other in others:
        other.result()
