"""`.ksplat` 0.1 of GaussianSplats3D (github.com/mkkellogg/GaussianSplats3D, MIT; layout as its 0.4.7 writes it).

A header of 4096 bytes, a header of 1024 bytes for each section, then the sections. A section has Gaussians of one
degree of spherical harmonics. At levels of compression above 0 they are sorted into buckets, cubes of one size: full
ones, then others whose lengths (u32) stand first. Then come the centres of all buckets (3 x f32), and the rows:

- position: 3 x f32; above level 0 u16 in steps of the bucket, from its centre;
- standard deviations and quaternion w, x, y, z: f32, above level 0 f16;
- colour and opacity: 4 x u8;
- spherical harmonics, degree by degree, red first: f32, f16, or u8 between two bounds of the file.

All is little-endian, and axes are those of the scene it was made from.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F32, F64
from scarfmt.errors import InvalidInput, Unsupported
from scarfmt.formats.quantise import dc_of_colour, logit_of_alpha
from scarfmt.formats.source import Source
from scarfmt.scene.gaussians import GaussianScene, concatenate

_HEADER, _SECTION = 4096, 1024
_VERSION = (0, 1)
_KINDS = (("<f4", "<f4", "<f4"), ("<u2", "<f2", "<f2"), ("<u2", "<f2", "u1"))
"""Types of position, of scale and rotation, and of harmonics at each level of compression."""
_COMPONENTS = (0, 9, 24, 45)
_BANDS = (slice(0, 9), slice(9, 24), slice(24, 45))
_HALF_RANGE = 32767
_SH_BOUND = 1.5


@dataclass(frozen=True)
class _Layout:
    """The header of a file."""

    level: int
    sections: int
    count: int
    sh_bounds: tuple[float, float]


@dataclass(frozen=True)
class _Section:
    """A section, its lengths as declared, and where it begins."""

    count: int
    rows: int
    bucket_size: int
    buckets: int
    block: float
    bucket_bytes: int
    half_range: int
    full: int
    partial: int
    degree: int
    start: int
    row: np.dtype[np.void]

    @property
    def rows_start(self) -> int:
        """Where its rows begin."""
        return self.start + 4 * self.partial + self.bucket_bytes * self.buckets

    @property
    def end(self) -> int:
        """One past its last byte."""
        return self.rows_start + self.row.itemsize * self.rows


def sniff(source: Source) -> bool:
    """Whether the content has the header, and is as long as its sections together: there is no other mark."""
    head = source.head(_HEADER)
    if len(head) < _HEADER or tuple(head[:2]) != _VERSION or head[2:4] != bytes(2):
        return False
    layout = _layout(head)
    if layout.level >= len(_KINDS) or not 0 < layout.sections <= source.size // _SECTION:
        return False
    try:
        *_, last = _sections(source.head(_HEADER + layout.sections * _SECTION), layout)
    except (ValueError, struct.error):
        return False
    return last.end == source.size


def load(source: Source) -> GaussianScene:
    """Read a `.ksplat` file. A standard deviation of zero gives a log scale of -inf.

    Raises:
        InvalidInput: damaged.
        Unsupported: another version.
    """
    data = source.read()
    if len(data) < _HEADER:
        raise source.corrupt(f"{len(data)} bytes is less than the header of a .ksplat")
    layout = _layout(data)
    if tuple(data[:2]) != _VERSION or layout.level >= len(_KINDS):
        message = f"{source.name}: .ksplat version {data[0]}.{data[1]}, compression level {layout.level}"
        raise Unsupported("input-version", f"{message}; this importer reads 0.1 and levels 0 to 2")
    parts = []
    try:
        for section in _sections(data, layout):
            parts.append(_read(source, data, section, layout))
    except InvalidInput:  # a ValueError too
        raise
    except (ValueError, struct.error) as error:
        raise source.corrupt(f"a damaged section of the .ksplat ({error})") from error
    scene = concatenate(parts)
    if len(scene) != layout.count:
        raise source.corrupt(f"{len(scene)} Gaussians in its sections, but its header declares {layout.count}")
    return scene


def _layout(head: bytes) -> _Layout:
    sections, _used, _most, count, level = struct.unpack_from("<4IH", head, 4)
    low, high = struct.unpack_from("<2f", head, 36)
    return _Layout(level, sections, count, (low or -_SH_BOUND, high or _SH_BOUND))


def _sections(data: bytes, layout: _Layout) -> Iterator[_Section]:
    """The sections that hold anything.

    Raises:
        ValueError, struct.error: cut, or of an unknown degree.
    """
    start = _HEADER + layout.sections * _SECTION
    for number in range(layout.sections):
        at = _HEADER + number * _SECTION
        count, rows, bucket_size, buckets, block, bucket_bytes = struct.unpack_from("<4IfH", data, at)
        half_range, _stored, full, partial, degree = struct.unpack_from("<4IH", data, at + 24)
        if degree > 3 or count > rows:
            raise ValueError(f"{count} of {rows} rows, spherical harmonics of degree {degree}")
        position, real, harmonic = _KINDS[layout.level]
        fields = [("position", position, 3), ("scale", real, 3), ("rotation", real, 4), ("colour", "u1", 4)]
        row = np.dtype([*fields, ("sh", harmonic, (_COMPONENTS[degree],))])
        section = _Section(
            count, rows, bucket_size, buckets, block, bucket_bytes, half_range or _HALF_RANGE, full, partial, degree,
            start, row,
        )  # fmt: skip
        start = section.end
        yield section


def _read(source: Source, data: bytes, section: _Section, layout: _Layout) -> GaussianScene:
    if section.end > len(data):
        raise source.corrupt(f"{len(data)} bytes, but its sections need {section.end}")
    rows = np.frombuffer(data, section.row, section.count, section.rows_start)
    with np.errstate(divide="ignore", invalid="ignore"):
        log_scales = np.log(rows["scale"].astype(np.float32))
    return GaussianScene(
        _positions(data, section, rows["position"], layout.level),
        log_scales,
        rows["rotation"].astype(np.float32),
        logit_of_alpha(rows["colour"][:, 3]),
        np.concatenate([dc_of_colour(rows["colour"][:, :3] / 255.0), _harmonics(rows["sh"], section, layout)], axis=1),
    )


def _positions(data: bytes, section: _Section, stored: NDArray[np.generic], level: int) -> F64:
    if level == 0:
        return stored.astype(np.float64)
    used = section.full + section.partial
    # The table of buckets lies in the file, if each has room for its centre.
    if section.bucket_bytes < 12 or used > section.buckets:
        raise ValueError(f"{used} buckets of {section.buckets}, of {section.bucket_bytes} bytes each")
    lengths = np.full(used, section.bucket_size, np.int64)
    lengths[section.full :] = np.frombuffer(data, "<u4", section.partial, section.start)
    if lengths.sum() < section.count:
        raise ValueError(f"{used} buckets hold {lengths.sum()} of {section.count} rows")
    table = np.frombuffer(data, np.uint8, section.bucket_bytes * section.buckets, section.start + 4 * section.partial)
    centres = np.ascontiguousarray(table.reshape(section.buckets, -1)[:, :12]).view("<f4").astype(np.float64)
    of_bucket = np.searchsorted(np.cumsum(lengths), np.arange(section.count), side="right")
    step = section.block / 2 / section.half_range
    return (stored.astype(np.float64) - section.half_range) * step + centres[of_bucket]


def _harmonics(stored: NDArray[np.generic], section: _Section, layout: _Layout) -> F32:
    """(N, R, 3) float32: in the file each degree has all of red, then green, then blue."""
    values = stored.astype(np.float32)
    if layout.level == 2:
        low, high = layout.sh_bounds
        values = (low + (high - low) * (values / np.float32(255))).astype(np.float32)
    bands = [values[:, band].reshape(len(values), 3, -1).transpose(0, 2, 1) for band in _BANDS[: section.degree]]
    return np.concatenate([np.empty((len(values), 0, 3), np.float32), *bands], axis=1)
