"""Points of a photo capture: what structure from motion found, as PLY or as COLMAP's `points3D`, binary, text or PLY.

Points are (P, 3) float64, world units, finite. Their colours are not read: training from them gains nothing (0061).
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from scarfmt.arrays import F64
from scarfmt.formats.ply import read_elements, read_header
from scarfmt.formats.source import Source
from scarfmt.render.capture.record import EXPORT_AGAIN, wrong

_RECORD = struct.Struct("<Q3d3BdQ")
"""A record of COLMAP: id, position, colour, error, length of the track. Each element of the track has 8 bytes."""
_TRACK = 8


def ply_points(path: Path) -> F64:
    """The vertices of a PLY file.

    Raises:
        InvalidInput: ``input-corrupt``, ``input-unreadable``, ``input-cameras``: it has no vertices, or some are not
            finite.
        LimitExceeded: ``input-limit``.
    """
    source = Source(path)
    rows = read_elements(source, read_header(source), ["vertex"]).get("vertex")
    if rows is None or not {"x", "y", "z"} <= set(rows.dtype.names or ()):
        raise wrong(str(path), "has no vertices with x, y and z; leave it out, or export it again")
    return _check(path, np.stack([rows[axis].astype(np.float64) for axis in "xyz"], axis=1))


def colmap_points(folder: Path) -> F64 | None:
    """The points of the sparse model in `folder`; None where there is no `points3D`.

    Raises:
        InvalidInput: ``input-cameras``.
        OSError: the file cannot be read.
    """
    for name, read in (("points3D.bin", _binary), ("points3D.txt", _text), ("points3D.ply", ply_points)):
        if (folder / name).is_file():
            return read(folder / name)
    return None


def _binary(path: Path) -> F64:
    data = path.read_bytes()
    (count,) = struct.unpack_from("<Q", data) if len(data) >= 8 else (1 << 63,)
    if count * _RECORD.size > len(data):
        raise wrong(str(path), "ends too early: it is cut short or no file of COLMAP; copy or export it again")
    positions = np.empty((count, 3))
    place = 8
    for row in range(count):
        if place + _RECORD.size > len(data):
            raise wrong(str(path), f"ends too early, in point {row + 1} of {count}; copy or export it again")
        _id, *values, track = _RECORD.unpack_from(data, place)
        positions[row] = values[:3]
        place += _RECORD.size + _TRACK * track
    return _check(path, positions)


def _text(path: Path) -> F64:
    positions = []
    with path.open(encoding="utf-8", errors="replace") as stream:
        for number, line in enumerate(stream, 1):
            words = line.split(maxsplit=7)
            if not words or line.startswith("#"):
                continue
            try:
                positions.append([float(word) for word in words[1:4]])
                if len(words) < 7:
                    raise ValueError("a word is missing")
            except ValueError as error:
                message = f"expected ID X Y Z R G B ERROR TRACK...; {EXPORT_AGAIN}"
                raise wrong(str(path), message, f"line {number}") from error
    return _check(path, np.array(positions, np.float64).reshape(-1, 3))


def _check(path: Path, positions: F64) -> F64:
    if not np.isfinite(positions).all():
        row = int(np.flatnonzero(~np.isfinite(positions).all(axis=1))[0])
        raise wrong(str(path), f"point {row + 1} is not at a finite place; {EXPORT_AGAIN}")
    return positions
