"""Niantic SPZ, versions 1 to 4 (github.com/nianticlabs/spz, README "File Format").

Attributes are stored one after the other, each for all Gaussians: positions, alphas, colours, log scales,
rotations, spherical harmonics. Versions 1 to 3 are one gzip stream that starts with the 16-byte header; version 4
is a 32-byte plain header, extension records, a table of (compressed, uncompressed) u64 sizes, and one zstd frame
for each attribute.

SPZ stores RUB axes, unless extension 0xADBE0003 says otherwise. They are flipped to RDF, the axes of INRIA's PLY,
by default, so that every importer gives scenes that one viewer shows upright.
"""

from __future__ import annotations

import itertools
import struct
import zlib
from collections.abc import Iterator
from typing import Literal

import numpy as np
import zstandard

from scarfmt.arrays import F32, F64, U8
from scarfmt.errors import Unsupported
from scarfmt.formats.dequantise import complete_smallest_three, logit_of_alpha
from scarfmt.formats.frame import RUB_TO_RDF, Signs, flip_axes
from scarfmt.formats.source import Source
from scarfmt.scene.gaussians import GaussianScene

MAGIC = b"NGSP"
_GZIP = b"\x1f\x8b"
COLOUR_SCALE = 0.15  # README: "wide RGB", f_dc = (byte / 255 - 0.5) / 0.15
_HAS_EXTENSIONS = 0x2
_COORDINATE_SYSTEM = 0xADBE0003
_MAX_EXTENSION_BYTES = 1 << 20


def sniff(source: Source) -> bool:
    """Whether the content starts as SPZ, within gzip or not."""
    head = source.head(512)
    if head[:2] == _GZIP:
        try:
            head = zlib.decompressobj(wbits=31).decompress(head, 4)
        except zlib.error:
            return False
    return head[:4] == MAGIC


def load(source: Source, *, frame: Literal["RDF", "RUB"] = "RDF") -> GaussianScene:
    """Read an SPZ file.

    Args:
        source: the file.
        frame: axes of the result; RUB keeps them as stored (but for files that declare other axes).

    Raises:
        InvalidInput: damaged.
        Unsupported: a newer version, spherical harmonics of degree 4, or axes that need a quarter turn.
        LimitExceeded: more Gaussians than any scene has.
    """
    gzipped = source.head(2) == _GZIP
    header, streams, extensions = (_read_gzip if gzipped else _read_v4)(source)
    version, count, degree, fraction_bits = header
    positions = _positions(streams[0].reshape(count, 6 if version == 1 else 9), version, fraction_bits)
    scene = GaussianScene(
        positions,
        (streams[3].reshape(count, 3) / 16.0 - 10.0).astype(np.float32),
        _rotations(streams[4].reshape(count, 3 if version < 3 else 4)),
        logit_of_alpha(streams[1]),
        _harmonics(streams[2].reshape(count, 1, 3), streams[5].reshape(count, (degree + 1) ** 2 - 1, 3)),
    )
    wanted = RUB_TO_RDF if frame == "RDF" else (1, 1, 1)
    stored = _stored_axes(source, extensions)
    x, y, z = (have * want for have, want in zip(stored, wanted, strict=True))
    return flip_axes(scene, (x, y, z))


Header = tuple[int, int, int, int]


def _read_header(source: Source, head: bytes) -> tuple[Header, list[int]]:
    """Version, count, SH degree, fractional bits; and the byte length of each attribute."""
    magic, version, count, degree, fraction_bits = struct.unpack_from("<4sIIBB", head)
    if magic != MAGIC:
        raise source.corrupt("no SPZ header", offset=0)
    if not 1 <= version <= 4:
        raise Unsupported("input-version", f"{source.name}: SPZ version {version}; this importer reads 1 to 4")
    if degree > 3:
        message = f"{source.name}: spherical harmonics of degree {degree}; export the scene again with degree 3"
        raise Unsupported("input-sh-degree", message, field="shDegree")
    source.check_count(count)
    widths = [6 if version == 1 else 9, 1, 3, 3, 3 if version < 3 else 4, 3 * ((degree + 1) ** 2 - 1)]
    return (version, count, degree, fraction_bits), [width * count for width in widths]


def _read_gzip(source: Source) -> tuple[Header, list[U8], bytes]:
    """Versions 1 to 3: what the gzip stream holds, inflated no further than its header justifies."""
    inflater = zlib.decompressobj(wbits=31)
    try:
        head = inflater.decompress(source.read(), 16)
        if len(head) < 16:
            raise source.corrupt("the gzip stream ends within the SPZ header")
        header, sizes = _read_header(source, head)
        limit = sum(sizes) + _MAX_EXTENSION_BYTES
        body = inflater.decompress(inflater.unconsumed_tail, limit)
    except zlib.error as error:
        raise source.corrupt(f"damaged gzip stream ({error})") from error
    if header[0] > 3:
        raise source.corrupt("SPZ version 4 is not gzipped")
    if len(body) < sum(sizes) or not inflater.eof:
        raise source.corrupt(f"{len(body)} bytes of attributes, expected {sum(sizes)}")
    bounds = np.cumsum([0, *sizes])
    data = np.frombuffer(body, np.uint8)
    streams = [data[start:end] for start, end in itertools.pairwise(bounds)]
    return header, streams, body[bounds[-1] :] if head[14] & _HAS_EXTENSIONS else b""


def _read_v4(source: Source) -> tuple[Header, list[U8], bytes]:
    """Version 4: one zstd frame for each attribute."""
    data = source.read()
    if len(data) < 32:
        raise source.corrupt(f"{len(data)} bytes is less than an SPZ header")
    header, sizes = _read_header(source, data)
    if header[0] != 4:
        raise source.corrupt(f"SPZ version {header[0]} must be gzipped")
    flags, streams_declared, table_at = struct.unpack_from("<BBI", data, 14)
    expected = 6 if sizes[5] else 5
    data_at = table_at + 16 * streams_declared
    if streams_declared < expected or table_at < 32 or data_at > len(data):
        raise source.corrupt(f"table of {streams_declared} streams at byte {table_at}", offset=table_at)
    streams = []
    for index, size in enumerate(sizes[:expected]):
        packed, unpacked = struct.unpack_from("<QQ", data, table_at + 16 * index)
        if unpacked != size or packed > len(data) - data_at:
            raise source.corrupt(f"stream {index}: {packed} bytes for {unpacked}, expected {size}", offset=data_at)
        streams.append(_inflate_zstd(source, data[data_at : data_at + packed], size, data_at))
        data_at += packed
    streams += [np.empty(0, np.uint8)] * (6 - expected)
    return header, streams, data[32:table_at] if flags & _HAS_EXTENSIONS else b""


def _inflate_zstd(source: Source, frame: bytes, size: int, offset: int) -> U8:
    """One zstd frame of exactly `size` bytes.

    A frame that declares its size is unpacked to that size whatever `max_output_size` says, so it is compared first.
    """
    try:
        declared = zstandard.get_frame_parameters(frame).content_size
        if declared not in (size, zstandard.CONTENTSIZE_UNKNOWN):
            raise source.corrupt(f"a zstd frame of {declared} bytes, expected {size}", offset=offset)
        body = zstandard.ZstdDecompressor().decompress(frame, max_output_size=max(size, 1))
    except zstandard.ZstdError as error:
        raise source.corrupt(f"damaged zstd frame ({error})", offset=offset) from error
    if len(body) != size:
        raise source.corrupt(f"a zstd frame of {len(body)} bytes, expected {size}", offset=offset)
    return np.frombuffer(body, np.uint8)


def _positions(raw: U8, version: int, fraction_bits: int) -> F64:
    """Version 1: float16. Later: 24-bit signed fixed point."""
    if version == 1:
        return np.ascontiguousarray(raw).view("<f2").astype(np.float64)
    triples = raw.reshape(len(raw), 3, 3).astype(np.int32)
    unsigned = triples[..., 0] | triples[..., 1] << 8 | triples[..., 2] << 16
    return np.ldexp(((unsigned ^ 0x800000) - 0x800000).astype(np.float64), -fraction_bits)


def _rotations(raw: U8) -> F32:
    """Quaternions w, x, y, z: from x, y, z bytes (three-byte rows), or the smallest three of x, y, z, w."""
    if raw.shape[1] == 3:
        kept = raw.astype(np.float64) / 127.5 - 1.0
        quaternions = complete_smallest_three(kept, np.full(len(raw), 3))
    else:
        words = np.ascontiguousarray(raw).view("<u4")
        fields = words >> np.array([20, 10, 0], np.uint32)
        magnitude = (fields & np.uint32(511)) / 511.0 * np.sqrt(0.5)
        kept = np.where(fields & np.uint32(512), -magnitude, magnitude)
        quaternions = complete_smallest_three(kept, words[:, 0] >> np.uint32(30))
    return quaternions[:, [3, 0, 1, 2]].astype(np.float32)


def _harmonics(colour: U8, rest: U8) -> F32:
    """(N, (degree + 1)^2, 3), through tables of the 256 values: in place, for they are most of a scene's memory."""
    levels = np.arange(256)
    sh = np.empty((len(colour), 1 + rest.shape[1], 3), np.float32)
    sh[:, :1] = ((levels / 255.0 - 0.5) / COLOUR_SCALE).astype(np.float32)[colour]
    sh[:, 1:] = ((levels - 128.0) / 128.0).astype(np.float32)[rest]
    return sh


def _stored_axes(source: Source, extensions: bytes) -> Signs:
    """Signs that take the stored axes to RUB."""
    for kind, payload in _extension_records(source, extensions):
        if kind != _COORDINATE_SYSTEM or payload == bytes(4):
            continue
        system = int.from_bytes(payload, "little")
        if not 1 <= system <= 8:
            message = f"{source.name}: SPZ coordinate system {system}; this importer reads the axis flips 1 to 8"
            raise Unsupported("input-frame", message, field="SPZ_ADOBE_coordinate_system")
        right, up, front = ((system - 1) >> bit & 1 for bit in range(3))
        return 1 if right else -1, 1 if up else -1, -1 if front else 1
    return 1, 1, 1


def _extension_records(source: Source, extensions: bytes) -> Iterator[tuple[int, bytes]]:
    at = 0
    while at < len(extensions):
        kind, length = struct.unpack_from("<II", extensions, at) if at + 8 <= len(extensions) else (0, len(extensions))
        at += 8 + length
        if at > len(extensions):
            raise source.corrupt("an SPZ extension record is longer than its block")
        yield kind, extensions[at - length : at]
