"""Points of a photo capture: what structure from motion found, as PLY or as COLMAP's `points3D`, binary or text."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scarfmt.arrays import F64, U8
from scarfmt.formats.ply import read_elements, read_header
from scarfmt.formats.source import Source
from scarfmt.render.capture.record import EXPORT_AGAIN, wrong

_GREY = 128
_RECORD = struct.Struct("<Q3d3BdQ")
"""A record of COLMAP: id, position, colour, error, length of the track. Each element of the track has 8 bytes."""
_TRACK = 8


@dataclass(frozen=True)
class Points:
    """Points on surfaces.

    Attributes:
        positions: (P, 3) float64, world units, finite.
        colours: (P, 3) uint8, red, green, blue; grey where the file has none.
    """

    positions: F64
    colours: U8


def ply_points(path: Path) -> Points:
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
    positions = np.stack([rows[axis].astype(np.float64) for axis in "xyz"], axis=1)
    names = ("red", "green", "blue")
    coloured = all(name in (rows.dtype.names or ()) and rows.dtype[name] == np.uint8 for name in names)
    colours = np.stack([rows[name] for name in names], axis=1) if coloured else np.full((len(rows), 3), _GREY, np.uint8)
    return _checked(path, positions, colours)


def colmap_points(folder: Path) -> Points | None:
    """The points of the sparse model in `folder`; None where there is no `points3D`.

    Raises:
        InvalidInput: ``input-cameras``.
        OSError: the file cannot be read.
    """
    for name, read in (("points3D.bin", _binary), ("points3D.txt", _text)):
        if (folder / name).is_file():
            return read(folder / name)
    return None


def _binary(path: Path) -> Points:
    data = path.read_bytes()
    (count,) = struct.unpack_from("<Q", data) if len(data) >= 8 else (1 << 63,)
    if count * _RECORD.size > len(data):
        raise wrong(str(path), "ends too early: it is cut short or no file of COLMAP; copy or export it again")
    positions, colours = np.empty((count, 3)), np.empty((count, 3), np.uint8)
    place = 8
    for row in range(count):
        if place + _RECORD.size > len(data):
            raise wrong(str(path), f"ends too early, in point {row + 1} of {count}; copy or export it again")
        _id, *values, _error, track = _RECORD.unpack_from(data, place)
        positions[row], colours[row] = values[:3], values[3:]
        place += _RECORD.size + _TRACK * track
    return _checked(path, positions, colours)


def _text(path: Path) -> Points:
    positions, colours = [], []
    with path.open(encoding="utf-8", errors="replace") as stream:
        for number, line in enumerate(stream, 1):
            words = line.split(maxsplit=7)
            if not words or line.startswith("#"):
                continue
            try:
                positions.append([float(word) for word in words[1:4]])
                colours.append(bytes(int(word) for word in words[4:7]))
                if len(colours[-1]) != 3:
                    raise ValueError("a word is missing")
            except ValueError as error:
                message = f"expected ID X Y Z R G B ERROR TRACK...; {EXPORT_AGAIN}"
                raise wrong(str(path), message, f"line {number}") from error
    table = np.frombuffer(b"".join(colours), np.uint8).reshape(-1, 3)
    return _checked(path, np.array(positions, np.float64).reshape(-1, 3), table)


def _checked(path: Path, positions: F64, colours: U8) -> Points:
    if not np.isfinite(positions).all():
        row = int(np.flatnonzero(~np.isfinite(positions).all(axis=1))[0])
        raise wrong(str(path), f"point {row + 1} is not at a finite place; {EXPORT_AGAIN}")
    return Points(positions, colours)
