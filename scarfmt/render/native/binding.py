"""The compiled renderer: found, loaded, its functions and structs declared as in ``raster.h`` and ``composite.h``."""

from __future__ import annotations

import ctypes
import math
from ctypes import POINTER, c_double, c_float, c_int32, c_int64, c_void_p, sizeof
from functools import cache
from pathlib import Path

from scarfmt.arrays import F64
from scarfmt.errors import InvalidInput
from scarfmt.native.binding import Absent, Signatures, find_library, open_library
from scarfmt.render.camera import Camera

INTERFACE = 4
"""The number of the interface in composite.c."""
TILE = 16
"""Pixels of a tile, each way."""
BLEND, MEASURE, UNBLEND = range(3)
"""What `scar_composite` does to tiles, as composite.h says."""
SPLAT, GRADIENTS, MEASURES = 12, 9, 3
"""Floats of a `Splat`, and of what the passes leave for an intersection."""
LOG_OPACITY, COLOUR = 8, slice(9, 12)
"""The floats of a `Splat` that are its opacity, to the base of 2, and its colour."""

MIN_ALPHA = 1.0 / 255.0
MAX_ALPHA = 0.99
MIN_TRANSMITTANCE = 1e-4
FRUSTUM_MARGIN = 1.3


class Scene(ctypes.Structure):
    """M Gaussians: `Scene` of raster.h."""

    _fields_ = (
        *((name, c_void_p) for name in ("centres", "scales", "rotations", "opacities", "colours", "harmonics")),
        *((name, c_int64) for name in ("coefficients", "degree")),
    )


class Lens(ctypes.Structure):
    """A camera: `Lens` of raster.h."""

    _fields_ = (
        ("pose", c_double * 12),
        ("eye", c_double * 3),
        *((name, c_float) for name in ("fx", "fy", "cx", "cy", "width", "height", "near", "dilation")),
        *((name, c_float) for name in ("limit_x", "limit_y", "min_alpha", "log_min_alpha")),
        ("antialiased", c_int32),
    )

    @classmethod
    def of(cls, camera: Camera, antialiased: bool = False) -> Lens:
        """A camera's, with the rules of the image model."""
        pose, eye = (
            (c_double * 12)(*camera.world_to_camera[:3].ravel().tolist()),
            (c_double * 3)(*camera.centre.tolist()),
        )
        return cls(pose, eye, *_view(camera), *_limits(camera), MIN_ALPHA, math.log2(MIN_ALPHA), antialiased)


class Outlook(ctypes.Structure):
    """A camera of nearby.c: `Outlook` there."""

    _fields_ = (
        ("pose", c_float * 12),
        *((name, c_float) for name in ("fx", "fy", "cx", "cy", "width", "height", "near", "dilation")),
        *((name, c_float) for name in ("limit_x", "limit_y")),
    )

    @classmethod
    def of(cls, camera: Camera, origin: F64) -> Outlook:
        """A camera's, seen from an origin: (3,) world units."""
        pose = camera.world_to_camera[:3].copy()
        pose[:, 3] += pose[:, :3] @ origin
        return cls((c_float * 12)(*pose.ravel().tolist()), *_view(camera), *_limits(camera))


def _view(camera: Camera) -> tuple[float, ...]:
    size = camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height
    return *size, camera.near, camera.dilation


def _limits(camera: Camera) -> tuple[float, float]:
    return FRUSTUM_MARGIN * camera.width / (2 * camera.fx), FRUSTUM_MARGIN * camera.height / (2 * camera.fy)


class Job(ctypes.Structure):
    """The arguments of compositing: `Job` of composite.h, which describes each."""

    _fields_ = (
        *((name, c_int64) for name in ("width", "height", "columns", "tiles")),
        *((name, c_float) for name in ("max_alpha", "min_alpha", "min_transmittance")),
        ("background", c_float * 3),
        *((name, c_void_p) for name in ("splats", "offsets", "listed", "owners", "image", "transmittance")),
        *((name, c_void_p) for name in ("weights", "drawn", "towards", "gradients", "measures")),
    )

    @classmethod
    def of(cls, camera: Camera) -> Job:
        """A picture's, with the rules of the image model; addresses are still null."""
        columns, rows = -(-camera.width // TILE), -(-camera.height // TILE)
        return cls(camera.width, camera.height, columns, columns * rows, MAX_ALPHA, MIN_ALPHA, MIN_TRANSMITTANCE)


_STRUCTS = sizeof(Job) + sizeof(Lens) + sizeof(Outlook) + sizeof(Scene) + 4 * SPLAT
_SIGNATURES: Signatures = {
    "scar_render_interface": (c_int64, []),
    "scar_render_structs": (c_int64, []),
    "scar_render_plainly": (None, [c_int64]),
    "scar_prepare": (None, [*[c_void_p] * 4, c_int64, c_float, *[c_void_p] * 3]),
    "scar_nearby": (c_int64, [POINTER(Outlook), c_void_p, c_int64, c_void_p]),
    "scar_see": (c_int64, [POINTER(Scene), POINTER(Lens), c_void_p, c_int64, *[c_void_p] * 6]),
    "scar_project_back": (None, [POINTER(Scene), POINTER(Lens), c_void_p, c_int64, c_int64, *[c_void_p] * 5]),
    "scar_count_tiles": (None, [c_void_p, c_int64, c_int64, c_int64, *[c_void_p] * 3]),
    "scar_list_tiles": (None, [c_void_p, c_int64, c_int64, *[c_void_p] * 3]),
    "scar_composite": (None, [POINTER(Job), c_int64, POINTER(c_int64)]),
    "scar_composite_measures": (None, [*[c_void_p] * 3, c_int64, c_void_p]),
    "scar_composite_gather": (None, [*[c_void_p] * 4, c_int64, c_int64, *[c_void_p] * 4]),
}


@cache
def load() -> ctypes.CDLL:
    """The library with its functions declared.

    Raises:
        InvalidInput: ``input-dependency``: it was not built, or for another machine or version.
    """
    try:
        library = open_library(find_library("scarfmt.render.native", Path(__file__).parent), _SIGNATURES)
        built = library.scar_render_interface(), library.scar_render_structs()
        if built != (INTERFACE, _STRUCTS):
            raise Absent(f"it was built from another version: {built}, not {(INTERFACE, _STRUCTS)}")
    except Absent as error:
        message = f"drawing needs the compiled renderer: {error}; install scarfmt anew where GCC or Clang is found"
        raise InvalidInput("input-dependency", message) from error
    return library
