"""Niantic SPZ, versions 1 to 4 (github.com/nianticlabs/spz, README "File Format").

Attributes are stored one after the other, each for all Gaussians: positions, alphas, colours, log scales,
rotations, spherical harmonics. Versions 1 to 3 are one gzip stream that starts with the 16-byte header; version 4
is a 32-byte plain header, extension records, a table of (compressed, uncompressed) u64 sizes, and one zstd frame
for each attribute.

SPZ stores RUB axes, unless extension 0xADBE0003 says otherwise. They are turned to RDF, the axes of INRIA's PLY,
so that every importer gives scenes that one viewer shows upright.

Spark (sparkjs.dev) adds a tree of levels of detail to version 3: flag 0x80, alphas of half the opacity, and after the
attributes a u16 number of children and a u32 first child of each node. Its leaves are the scene.
"""

from __future__ import annotations

import io
import itertools
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

import numpy as np
import zstandard
from numpy.typing import NDArray

from scarfmt.arrays import F32, F64, U8, U32
from scarfmt.container.registries import RenderModel
from scarfmt.errors import InvalidInput, Unsupported
from scarfmt.formats.frame import RUB_TO_RDF, flip_axes, signs_to
from scarfmt.formats.output import Described, Losses, Parts, Says, Spool, Written, finite, gaussian_sizes
from scarfmt.formats.quantise import (
    alpha_of_logit,
    complete_smallest_three,
    logit_of_alpha,
    smallest_three,
    unit_quaternions,
)
from scarfmt.formats.source import GZIP, Source, gunzip
from scarfmt.limits import MAX_SH_DEGREE
from scarfmt.scene.description import Description
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.scene.placement import Placement

MAGIC = b"NGSP"
COLOUR_SCALE = 0.15  # README: "wide RGB", f_dc = (byte / 255 - 0.5) / 0.15
_ANTIALIASED, _HAS_EXTENSIONS, _TREE = 0x1, 0x2, 0x80
_NODE_BYTES = 6
_FIRST_PLAIN = 4
"""The first version that is no gzip file."""
_HEAD = 512
"""Bytes that hold the header, gzipped or not."""
_ORBIT, _COORDINATE_SYSTEM = 0xADBE0002, 0xADBE0003
"""Extensions of Adobe: limits for a camera, which do not change the scene, and the axes."""
_RUB = 4
_MOST_COEFFICIENTS = 15
_MOST_FRACTION_BITS = 32
"""With more, no position of 24 bits is beyond 1/512: writers that forget the number leave 255."""
_MAX_EXTENSION_BYTES = 1 << 20


def sniff(source: Source) -> bool:
    """Whether the content starts as SPZ, versions before 4 within gzip.

    A later one within gzip is a file that somebody packed.
    """
    try:
        head = _head(source)
    except zlib.error:
        return False
    return head[:4] == MAGIC and (source.head(2) != GZIP or int.from_bytes(head[4:8], "little") < _FIRST_PLAIN)


def _head(source: Source) -> bytes:
    head = source.head(_HEAD)
    return gunzip(io.BytesIO(head), 16)[0] if head[:2] == GZIP else head


def load(source: Source) -> GaussianScene:
    """Read an SPZ file, in RDF axes.

    Raises:
        InvalidInput: damaged.
        Unsupported: a newer version, or flags and extensions that are not known.
        LimitExceeded: more Gaussians than any scene has.

    Warns:
        InputWarning: spherical harmonics of degree 4, or inner nodes of a tree, are left out.
    """
    gzipped = source.head(2) == GZIP
    header, streams, extensions, tree = (_read_gzip if gzipped else _read_v4)(source)
    version, count, degree, fraction_bits = header
    if degree > MAX_SH_DEGREE:
        source.warn("spherical harmonics of degree 4 are left out: scenes here have degree 3")
    rest = streams[5].reshape(count, (degree + 1) ** 2 - 1, 3)[:, :_MOST_COEFFICIENTS]
    scene = GaussianScene(
        _positions(streams[0].reshape(count, 6 if version == 1 else 9), version, fraction_bits),
        (streams[3].reshape(count, 3) / 16.0 - 10.0).astype(np.float32),
        _rotations(streams[4].reshape(count, 3 if version < 3 else 4)),
        logit_of_alpha(streams[1] if tree is None else np.minimum(streams[1], 127) * 2 + (streams[1] > 127)),
        _harmonics(streams[2].reshape(count, 1, 3), rest),
    )
    if tree is not None:
        scene = leaves(source, scene, np.frombuffer(tree, "<u2", len(scene)))
    return flip_axes(_to_rub(source, scene, extensions), RUB_TO_RDF)


def leaves(source: Source, scene: GaussianScene, children: NDArray[np.integer]) -> GaussianScene:
    """The finest level of Spark's tree of levels of detail.

    Args:
        source: for messages.
        scene: all nodes of the tree.
        children: (N,) numbers of their children.

    Raises:
        InvalidInput: ``input-corrupt``: every node has some.

    Warns:
        InputWarning: how many nodes are left out.
    """
    finest = children == 0
    if not finest.any():
        raise source.corrupt("every node of the tree has children")
    inner = len(scene) - int(np.count_nonzero(finest))
    source.warn(f"{inner:,} of {len(scene):,} Gaussians are coarser levels of Spark's tree, and left out")
    return scene.take(finest)


def describe(source: Source) -> Description:
    """What the flags of the header say about the scene: whether it was trained with antialiasing."""
    return Description(RenderModel.ANTIALIASED if _head(source)[14] & _ANTIALIASED else RenderModel.CLASSIC)


Header = tuple[int, int, int, int]


def _read_header(source: Source, head: bytes) -> tuple[Header, list[int]]:
    """Version, count, SH degree, fractional bits; and the byte length of each attribute."""
    magic, version, count, degree, fraction_bits = struct.unpack_from("<4sIIBB", head)
    if magic != MAGIC:
        raise source.corrupt("no SPZ header", offset=0)
    if not 1 <= version <= 4:
        raise Unsupported("input-version", f"{source.name}: SPZ version {version}; this importer reads 1 to 4")
    if degree > 4:
        message = f"{source.name}: spherical harmonics of degree {degree}; export the scene again with degree 3"
        raise Unsupported("input-sh-degree", message, field="shDegree")
    unknown = head[14] & ~(_ANTIALIASED | _HAS_EXTENSIONS | (_TREE if version < 4 else 0))
    if unknown or (head[14] & _TREE and head[14] & _HAS_EXTENSIONS):
        message = f"{source.name}: SPZ flags {head[14]:#x}, not known together in version {version}"
        raise Unsupported("input-version", f"{message}; export the scene as a PLY", field="flags")
    if version > 1 and fraction_bits > _MOST_FRACTION_BITS:
        raise source.corrupt(f"positions in steps of 2^-{fraction_bits} all lie at zero", field="fractionalBits")
    source.check_count(count, sh_degree=degree)
    widths = [6 if version == 1 else 9, 1, 3, 3, 3 if version < 3 else 4, 3 * ((degree + 1) ** 2 - 1)]
    return (version, count, degree, fraction_bits), [width * count for width in widths]


Stored = tuple[Header, list[U8], bytes, bytes | None]
"""Header, attributes, extension records, and the nodes of a tree."""


def _read_gzip(source: Source) -> Stored:
    """Versions 1 to 3: what the gzip stream holds, inflated no further than its header justifies."""
    packed = source.read()
    try:
        head, _ = gunzip(io.BytesIO(packed), 16)
        if len(head) < 16:
            raise source.corrupt("the gzip stream ends within the SPZ header")
        header, sizes = _read_header(source, head)
        nodes = _NODE_BYTES * header[1] if head[14] & _TREE else 0
        whole, is_all = gunzip(io.BytesIO(packed), 16 + sum(sizes) + nodes + _MAX_EXTENSION_BYTES)
    except zlib.error as error:
        raise source.corrupt(f"damaged gzip stream ({error})") from error
    if header[0] > 3:
        raise source.corrupt("SPZ version 4 is not gzipped")
    body = memoryview(whole)[16:]
    if len(body) < sum(sizes) + nodes:
        raise source.corrupt(f"{len(body)} bytes of attributes, expected {sum(sizes) + nodes}")
    if not is_all:
        raise source.corrupt("the gzip stream has no end, or holds far more than the attributes")
    bounds = np.cumsum([0, *sizes])
    data = np.frombuffer(body, np.uint8)
    streams = [data[start:end] for start, end in itertools.pairwise(bounds)]
    more = bytes(body[bounds[-1] :])
    return header, streams, more if head[14] & _HAS_EXTENSIONS else b"", more[:nodes] if nodes else None


def _read_v4(source: Source) -> Stored:
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
    if streams_declared > 6:
        message = f"{source.name}: {streams_declared} streams; this importer knows 6; export the scene as a PLY"
        raise Unsupported("input-version", message, field="numStreams")
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
    return header, streams, data[32:table_at] if flags & _HAS_EXTENSIONS else b"", None


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


def _to_rub(source: Source, scene: GaussianScene, extensions: bytes) -> GaussianScene:
    """A scene of the stored axes in RUB.

    The three bits of systems 1 to 8 say right, up and front. SPZ's library turns 9 to 16 about x after the same flips,
    though by their names half of them would be flipped otherwise: it is what writes them.
    """
    system = _coordinate_system(source, extensions)
    right, up, front = ((system - 1) >> bit & 1 for bit in range(3))
    flipped = flip_axes(scene, (1 if right else -1, 1 if up else -1, -1 if front else 1))
    return flipped if system <= 8 else Placement.of(_QUARTER_TURN).scene(flipped)


_QUARTER_TURN = [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
"""From right, front, up to right, up, back."""


def _coordinate_system(source: Source, extensions: bytes) -> int:
    """Number of the axes; RUB where nothing says.

    Raises:
        Unsupported: ``input-frame``: an unknown number; ``input-version``: an extension that may change the scene.
    """
    system = 0
    for kind, payload in _extension_records(source, extensions):
        if kind not in (_ORBIT, _COORDINATE_SYSTEM):
            message = f"{source.name}: SPZ extension {kind:#010x} is not known and may change the scene"
            raise Unsupported("input-version", f"{message}; export the scene as a PLY", field="extensions")
        if kind == _COORDINATE_SYSTEM:
            system = int.from_bytes(payload, "little")
    if system > 16:
        message = f"{source.name}: SPZ coordinate system {system}; this importer reads 1 to 16"
        raise Unsupported("input-frame", message, field="SPZ_ADOBE_coordinate_system")
    return system or _RUB


def _extension_records(source: Source, extensions: bytes) -> Iterator[tuple[int, bytes]]:
    at = 0
    while at < len(extensions):
        kind, length = struct.unpack_from("<II", extensions, at) if at + 8 <= len(extensions) else (0, len(extensions))
        at += 8 + length
        if at > len(extensions):
            raise source.corrupt("an SPZ extension record is longer than its block")
        yield kind, extensions[at - length : at]


MAX_FRACTION_BITS = 24
_MAX_COORDINATE = (1 << 23) - 1
_ATTRIBUTES = ("positions", "alphas", "colours", "scales", "rotations", "harmonics")
_ROWS = 1 << 16
_GZIP_LEVEL, _ZSTD_LEVEL = 6, 12


@dataclass(frozen=True)
class SpzOptions:
    """Choices that the format leaves to its writer.

    Attributes:
        version: 3, gzip, or 4, zstd.
        fraction_bits: n of the step 2^-n of positions; None for the finest step that reaches the farthest Gaussian.
        sh_bits: of each coefficient of degree 1, and of those above; 1..8. Fewer compress better.
    """

    version: int = 4
    fraction_bits: int | None = None
    sh_bits: tuple[int, int] = (5, 4)


def write_spz(parts: Parts, described: Described, target: BinaryIO, options: SpzOptions | None = None) -> Written:
    """Write an SPZ file, in RUB axes.

    Args:
        parts: of the scene; Gaussians keep their order.

    Raises:
        InvalidInput: ``output-range``: a value is not finite, or a position is beyond the reach of the 24 bits;
            ``output-empty``.
    """
    options = options or SpzOptions()
    signs = signs_to(RUB_TO_RDF, described.frame)
    losses, farthest, count = Losses(), 0.0, 0
    with Spool(("raw positions", "sizes", *_ATTRIBUTES)) as spool:
        for part in finite(parts, "SPZ"):
            scene = flip_axes(part, signs)
            farthest = max(farthest, float(np.abs(scene.positions).max()))
            count += len(scene)
            spool.add("raw positions", scene.positions.astype("<f8"))
            spool.add("sizes", gaussian_sizes(scene.log_scales))
            for name, values in _quantise(scene, options, losses).items():
                spool.add(name, values)
        bits = _fraction_bits(farthest, options.fraction_bits)
        sizes = spool.reopen("sizes")
        for rows in _rows(spool.reopen("raw positions")):
            spool.add("positions", _fixed_point(rows, bits))
            losses.compare_steps(2.0**-bits, np.frombuffer(sizes.read(8 * len(rows)), np.float64))
        if options.fraction_bits is None:
            others = "leave out Gaussians far from all others, write another format"
            losses.refuse_coarse("SPZ", f"{others}, or accept it with --spz-fraction-bits {bits}")
        antialiased = described.description.render_model == RenderModel.ANTIALIASED
        flags = _ANTIALIASED if antialiased else 0
        head = struct.pack("<4sIIBBB", MAGIC, options.version, count, described.sh_degree, bits, flags)
        names = _ATTRIBUTES if described.sh_degree else _ATTRIBUTES[:-1]
        (_write_gzip if options.version == 3 else _write_v4)(head, spool, names, target)
    says = Says.AXES | (Says.RENDER_MODEL if antialiased else Says.NOTHING)
    return Written(count, (_grid(bits, options.sh_bits, described), *losses.notes(described, count, "SPZ", says)))


def _grid(bits: int, sh_bits: tuple[int, int], described: Described) -> str:
    """What every Gaussian loses."""
    harmonics = f", spherical harmonics of degree 1 to {sh_bits[0]} bits" if described.sh_degree else ""
    harmonics += f" and above to {sh_bits[1]}" if described.sh_degree > 1 else ""
    return f"SPZ rounds positions to {2.0**-bits:.3g}, scales to 6 %, opacities to 1/255, colours to 0.026{harmonics}"


def _fraction_bits(farthest: float, wanted: int | None) -> int:
    """Fractional bits of the positions.

    Raises:
        InvalidInput: ``output-range``.
    """
    most = MAX_FRACTION_BITS
    while most >= 0 and np.rint(np.ldexp(farthest, most)) > _MAX_COORDINATE:
        most -= 1
    if most < (wanted or 0):
        others = "leave out Gaussians far from all others, or make the scene smaller"
        advice = f"at most {most} fractional bits reach it" if most >= 0 else others
        message = f"a coordinate of {farthest:g} is beyond what SPZ holds in 24 bits of step 2^-{wanted or 0}; {advice}"
        raise InvalidInput("output-range", message)
    return most if wanted is None else wanted


def _rows(stream: BinaryIO) -> Iterator[F64]:
    while data := stream.read(24 * _ROWS):
        yield np.frombuffer(data, "<f8").reshape(-1, 3)


def _fixed_point(positions: F64, bits: int) -> U8:
    """(n, 3, 3) bytes: 24-bit two's complement, lowest byte first."""
    fixed = np.rint(np.ldexp(positions, bits)).astype("<i4")
    return fixed.view(np.uint8).reshape(len(positions), 3, 4)[..., :3]


def _quantise(scene: GaussianScene, options: SpzOptions, losses: Losses) -> dict[str, NDArray[np.generic]]:
    """All attributes but positions, as stored."""
    scales = (scene.log_scales.astype(np.float64) + 10.0) * 16.0
    colours = (scene.sh[:, 0].astype(np.float64) * COLOUR_SCALE + 0.5) * 255.0
    losses.count("scales outside e^-10 to e^5.94, set to the nearest", _outside(scales))
    losses.count("colours outside those of SPZ, set to the nearest", _outside(colours))
    return {
        "alphas": alpha_of_logit(scene.opacity_logits),
        "colours": _to_bytes(colours),
        "scales": _to_bytes(scales),
        "rotations": _pack_rotations(scene.rotations),
        "harmonics": _pack_harmonics(scene.sh[:, 1:], options.sh_bits, losses),
    }


def _outside(levels: F64) -> NDArray[np.bool_]:
    return (levels < -0.5) | (levels > 255.5)


def _to_bytes(levels: F64) -> U8:
    return np.rint(np.clip(levels, 0, 255)).astype(np.uint8)


def _pack_rotations(quaternions: F32) -> U32:
    """(N,) words: 2 bits name the omitted one of x, y, z, w; then sign and 9 bits of magnitude of each other."""
    kept, omitted = smallest_three(unit_quaternions(quaternions)[:, [1, 2, 3, 0]])
    magnitude = np.minimum(np.rint(np.abs(kept) * (511 * np.sqrt(2.0))), 511).astype(np.uint32)
    fields = magnitude | (kept < 0).astype(np.uint32) << np.uint32(9)
    words = omitted.astype(np.uint32) << np.uint32(30)
    words |= fields[:, 0] << np.uint32(20) | fields[:, 1] << np.uint32(10) | fields[:, 2]
    return np.asarray(words, "<u4")


def _pack_harmonics(rest: F32, bits: tuple[int, int], losses: Losses) -> U8:
    """(N, R, 3) bytes, each the nearest multiple of 2^(8 - bits): 0 is such a multiple, so it stays 0."""
    levels = rest.astype(np.float64) * 128.0 + 128.0
    losses.count("spherical harmonics outside -1 to 1, set to the nearest", (levels < -0.5) | (levels > 256.5))
    steps = np.array([1 << (8 - bits[0])] * 3 + [1 << (8 - bits[1])] * 12)[: rest.shape[1], None]
    return np.asarray(np.clip(np.floor(levels / steps + 0.5) * steps, 0, 255), np.uint8)


def _write_gzip(head: bytes, spool: Spool, names: tuple[str, ...], target: BinaryIO) -> None:
    """Version 3: one gzip stream, without a time in it."""
    deflater = zlib.compressobj(_GZIP_LEVEL, zlib.DEFLATED, 31)
    target.write(deflater.compress(head + bytes(1)))
    for name in names:
        stream = spool.reopen(name)
        while data := stream.read(1 << 20):
            target.write(deflater.compress(data))
    target.write(deflater.flush())


def _write_v4(head: bytes, spool: Spool, names: tuple[str, ...], target: BinaryIO) -> None:
    """Version 4: a table of sizes, then one zstd frame for each attribute."""
    compressor = zstandard.ZstdCompressor(level=_ZSTD_LEVEL)
    with Spool(names) as packed:
        table = b""
        for name in names:
            size = spool.size(name)
            compressor.copy_stream(spool.reopen(name), packed.reopen(name), size=size)
            table += struct.pack("<QQ", packed.size(name), size)
        target.write(head + struct.pack("<BI12x", len(names), 32) + table)
        for name in names:
            packed.copy(name, target)
