"""Names and numbers of glTF 2.0 and of its extension KHR_gaussian_splatting, for the reader and the writer.

The extension is a release candidate (text of 2026-07-17, github.com/KhronosGroup/glTF). Gaussians are the vertices of a
primitive of points: POSITION; unit quaternions x, y, z, w; linear scales; opacities 0..1; spherical harmonics in
INRIA's sign and order, an attribute for each coefficient. Axes are those of glTF assets: x left, y up, z forward.
"""

from __future__ import annotations

import struct

EXTENSION = "KHR_gaussian_splatting"
POINTS = 0
KERNEL, PROJECTION, SORTING = "ellipse", "perspective", "cameraDistance"
SRGB, LINEAR = "srgb_rec709_display", "lin_rec709_display"

POSITION, COLOUR = "POSITION", "COLOR_0"
ROTATION, SCALE, OPACITY = (f"{EXTENSION}:{name}" for name in ("ROTATION", "SCALE", "OPACITY"))

BYTE, UBYTE, SHORT, USHORT, UINT, FLOAT = 5120, 5121, 5122, 5123, 5125, 5126
COMPONENTS = {BYTE: "<i1", UBYTE: "<u1", SHORT: "<i2", USHORT: "<u2", UINT: "<u4", FLOAT: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}

GLB = struct.Struct("<4sII")
"""Magic, version, length of a .glb file."""
CHUNK = struct.Struct("<I4s")
"""Length and type of a chunk."""
GLB_MAGIC, GLB_VERSION, JSON_CHUNK, BINARY_CHUNK = b"glTF", 2, b"JSON", b"BIN\0"


def harmonic(degree: int, coefficient: int) -> str:
    """The attribute of a coefficient, 0..2 * degree."""
    return f"{EXTENSION}:SH_DEGREE_{degree}_COEF_{coefficient}"


def harmonics(degree: int) -> list[str]:
    """The attributes of one degree, lowest order first."""
    return [harmonic(degree, coefficient) for coefficient in range(2 * degree + 1)]
