"""Writing Niantic SPZ, version 3 or 4; the layout is in :mod:`scarfmt.formats.spz`.

Attributes stand one after the other, so they wait aside in quantised form; positions, whose step depends on the
farthest of them, as float64. Memory does not grow with the scene.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

import numpy as np
import zstandard
from numpy.typing import NDArray

from scarfmt.arrays import F32, F64, U8, U32
from scarfmt.errors import InvalidInput
from scarfmt.formats.aside import Aside
from scarfmt.formats.frame import RUB_TO_RDF, flip_axes, signs_to
from scarfmt.formats.output import Described, Losses, Parts, Written, finite
from scarfmt.formats.quantise import alpha_of_logit, smallest_three, unit_quaternions
from scarfmt.formats.spz import COLOUR_SCALE, MAGIC
from scarfmt.scene.gaussians import GaussianScene

VERSIONS = (3, 4)
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
        described: the scene.
        target: where to.
        options: of the format.

    Raises:
        InvalidInput: ``output-range``: a value is not finite, or a position is beyond the reach of the 24 bits;
            ``output-empty``.
    """
    options = options or SpzOptions()
    signs = signs_to(RUB_TO_RDF, described.frame)
    losses, farthest, count = Losses(), 0.0, 0
    with Aside(("raw positions", *_ATTRIBUTES)) as aside:
        for part in finite(parts, "SPZ"):
            scene = flip_axes(part, signs)
            farthest = max(farthest, float(np.abs(scene.positions).max()))
            count += len(scene)
            aside.add("raw positions", scene.positions.astype("<f8"))
            for name, values in _quantised(scene, options, losses).items():
                aside.add(name, values)
        bits = _fraction_bits(farthest, options.fraction_bits)
        for rows in _rows(aside.reopened("raw positions")):
            aside.add("positions", _fixed_point(rows, bits))
        head = struct.pack("<4sIIBBB", MAGIC, options.version, count, described.sh_degree, bits, 0)
        names = _ATTRIBUTES if described.sh_degree else _ATTRIBUTES[:-1]
        (_write_gzip if options.version == 3 else _write_v4)(head, aside, names, target)
    return Written(count, losses.notes(described, count, axes_of="SPZ", colours_of="SPZ"))


def _fraction_bits(farthest: float, wanted: int | None) -> int:
    """Fractional bits of the positions.

    Raises:
        InvalidInput: ``output-range``.
    """
    most = MAX_FRACTION_BITS
    while most >= 0 and np.rint(np.ldexp(farthest, most)) > _MAX_COORDINATE:
        most -= 1
    if most < (wanted or 0):
        advice = f"at most {most} fractional bits reach it" if most >= 0 else "make the scene smaller"
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


def _quantised(scene: GaussianScene, options: SpzOptions, losses: Losses) -> dict[str, NDArray[np.generic]]:
    """All attributes but positions, as stored."""
    scales = (scene.log_scales.astype(np.float64) + 10.0) * 16.0
    colours = (scene.sh[:, 0].astype(np.float64) * COLOUR_SCALE + 0.5) * 255.0
    losses.count("scales outside e^-10 to e^5.94, set to the nearest", _outside(scales))
    losses.count("colours outside those of SPZ, set to the nearest", _outside(colours))
    return {
        "alphas": alpha_of_logit(scene.opacity_logits),
        "colours": _bytes(colours),
        "scales": _bytes(scales),
        "rotations": _rotations(scene.rotations),
        "harmonics": _harmonics(scene.sh[:, 1:], options.sh_bits, losses),
    }


def _outside(levels: F64) -> NDArray[np.bool_]:
    return (levels < -0.5) | (levels > 255.5)


def _bytes(levels: F64) -> U8:
    return np.rint(np.clip(levels, 0, 255)).astype(np.uint8)


def _rotations(quaternions: F32) -> U32:
    """(N,) words: 2 bits name the omitted one of x, y, z, w; then sign and 9 bits of magnitude of each other."""
    kept, omitted = smallest_three(unit_quaternions(quaternions)[:, [1, 2, 3, 0]])
    magnitude = np.minimum(np.rint(np.abs(kept) * (511 * np.sqrt(2.0))), 511).astype(np.uint32)
    fields = magnitude | (kept < 0).astype(np.uint32) << np.uint32(9)
    words = omitted.astype(np.uint32) << np.uint32(30)
    words |= fields[:, 0] << np.uint32(20) | fields[:, 1] << np.uint32(10) | fields[:, 2]
    return np.asarray(words, "<u4")


def _harmonics(rest: F32, bits: tuple[int, int], losses: Losses) -> U8:
    """(N, R, 3) bytes, each the nearest multiple of 2^(8 - bits): 0 is such a multiple, so it stays 0."""
    levels = rest.astype(np.float64) * 128.0 + 128.0
    losses.count("spherical harmonics outside -1 to 1, set to the nearest", (levels < -0.5) | (levels > 256.5))
    steps = np.array([1 << (8 - bits[0])] * 3 + [1 << (8 - bits[1])] * 12)[: rest.shape[1], None]
    return np.asarray(np.clip(np.floor(levels / steps + 0.5) * steps, 0, 255), np.uint8)


def _write_gzip(head: bytes, aside: Aside, names: tuple[str, ...], target: BinaryIO) -> None:
    """Version 3: one gzip stream, without a time in it."""
    deflater = zlib.compressobj(_GZIP_LEVEL, zlib.DEFLATED, 31)
    target.write(deflater.compress(head + bytes(1)))
    for name in names:
        stream = aside.reopened(name)
        while data := stream.read(1 << 20):
            target.write(deflater.compress(data))
    target.write(deflater.flush())


def _write_v4(head: bytes, aside: Aside, names: tuple[str, ...], target: BinaryIO) -> None:
    """Version 4: a table of sizes, then one zstd frame for each attribute."""
    compressor = zstandard.ZstdCompressor(level=_ZSTD_LEVEL)
    with Aside(names) as packed:
        table = b""
        for name in names:
            size = aside.size(name)
            compressor.copy_stream(aside.reopened(name), packed.reopened(name), size=size)
            table += struct.pack("<QQ", packed.size(name), size)
        target.write(head + struct.pack("<BI12x", len(names), 32) + table)
        for name in names:
            packed.copy(name, target)
