"""Byte layout of the `.scar` container: every structure and field, once (SPEC §5).

All integers are little-endian and unsigned, floats are IEEE 754 binary64, structures are packed without padding.
A file is, in this order and with nothing between or after:

1. `FILE_HEADER` (100 bytes; its first 12 are the signature and version),
2. `LAYER_SUMMARY` x layer_count (136 bytes each),
3. `HEADER_CHECKSUM` (4 bytes): CRC-32 of all bytes before it,
4. ROOT (root_length bytes): the blocks that belong to no tile, and where the pages are (:mod:`.root`),
5. tile pages, then row pages by layer: where tiles lie, and what blocks they have (:mod:`.pages`),
6. the blocks in the order of (layer, kind, tile), back to back, the last one ending at file_length.

CRC-32 is the one of zlib, PNG and Ethernet: reflected polynomial 0xEDB88320, initial value and final XOR
0xFFFFFFFF. A cut file stays readable up to its last whole block because 1-5 come first.

The description of a field is normative: SPEC.md's tables are made from it, and error messages quote it.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

# Given on here: whoever needs the layout needs the identifiers, too.
from scarfmt.container.registries import READABLE_KINDS as READABLE_KINDS
from scarfmt.container.registries import BlockFlag as BlockFlag
from scarfmt.container.registries import BlockKind as BlockKind
from scarfmt.container.registries import ColourSpace as ColourSpace
from scarfmt.container.registries import CoordinateFrame as CoordinateFrame
from scarfmt.container.registries import Profile as Profile
from scarfmt.container.registries import RenderModel as RenderModel
from scarfmt.container.registries import Stream as Stream

SIGNATURE = bytes.fromhex("89 53 43 41 52 0D 0A 1A 0A")
"""0x89 catches a stripped high bit, CR LF and LF catch newline translation, 0x1A stops a DOS `type`."""

VERSION = (0, 3)
"""(major, minor) this package reads and writes. While major is 0, every minor version is its own format."""

NO_TILE = 0xFFFFFFFF
"""The value of `tile` in ENTRY_DTYPE for a block that belongs to no tile."""


STREAM_COUNT = len(Stream)


class Field(NamedTuple):
    """One field of a structure: byte offset in it, byte size, type, name, normative description."""

    offset: int
    size: int
    type: str
    name: str
    description: str

    def read(self, data: bytes, start: int) -> Any:
        """The value in a structure at `start`: a number, bytes, or a tuple of numbers."""
        code, several = _layout(self.type)
        values = struct.unpack_from(code, data, start + self.offset)
        return values if several else values[0]

    def write(self, value: Any) -> bytes:
        """The bytes of a value that :meth:`read` gives.

        Raises:
            struct.error: it does not fit.
        """
        code, several = _layout(self.type)
        return struct.pack(code, *value) if several else struct.pack(code, value)


Structure = tuple[Field, ...]

_CODES = {"u8": "B", "u32": "I", "u64": "Q", "f64": "d"}


def _layout(kind: str) -> tuple[str, bool]:
    """A type such as ``u64[13]`` as :mod:`struct` has it, and whether it is several numbers; several u8 are bytes."""
    scalar, _, count = kind.rstrip("]").partition("[")
    if count and scalar == "u8":
        return f"<{count}s", False
    return f"<{count}{_CODES[scalar]}", bool(count)


def _structure(*members: tuple[str, str, str]) -> Structure:
    """The fields of a structure, from name, type and description of each."""
    fields: list[Field] = []
    offset = 0
    for name, kind, description in members:
        fields.append(Field(offset, struct.calcsize(_layout(kind)[0]), kind, name, description))
        offset += fields[-1].size
    return tuple(fields)


def size_of(structure: Structure) -> int:
    """Bytes of a structure."""
    return structure[-1].offset + structure[-1].size


def parse(structure: Structure, data: bytes, start: int = 0) -> Any:
    """The values of a structure at `start`, by name as attributes."""
    return SimpleNamespace(**{field.name: field.read(data, start) for field in structure})


def build(structure: Structure, values: Mapping[str, Any]) -> bytes:
    """The bytes of a structure of these values; others are ignored.

    Raises:
        struct.error: a value does not fit its field.
    """
    return b"".join(field.write(values[field.name]) for field in structure)


FILE_HEADER = _structure(
    ("signature", "u8[9]", "89 53 43 41 52 0D 0A 1A 0A"),
    ("major", "u8", "Version, major: 0. Another major is another format"),
    ("minor", "u8", "Version, minor: 3. While major is 0, another minor is another format"),
    ("render_model", "u8", "How to draw: 0 classic, 1 antialiased, 2 two-dimensional"),
    ("header_length", "u32", "Bytes from the signature through header_crc32: 104 + 136 * layer_count"),
    ("file_length", "u64", "Bytes of the whole file, below 2^53"),
    ("profile", "u8", "Profile: 0 explicit, 1 anchor"),
    ("sh_degree", "u8", "Degree of the decoded spherical harmonics, 0..3; 0 in the anchor profile"),
    ("layer_count", "u8", "Layers in this file, 1..16"),
    ("slots", "u8", "Gaussian slots of an anchor, 1..32; 1 in the explicit profile"),
    ("lattice_bits", "u8", "Bits per axis of the position lattice, 1..32"),
    ("coordinate_frame", "u8", "0 unspecified, 1 RDF (x right, y down, z forward), 2 RUB (x right, y up, z back)"),
    ("colour_space", "u8", "0 unspecified, 1 sRGB display-referred, 2 linear"),
    ("page_bits", "u8", "A page is of 2^page_bits tiles, 0..16"),
    ("tile_count", "u32", "Tiles"),
    ("root_length", "u32", "Bytes of ROOT"),
    ("anchor_count", "u64", "Anchors after the last layer present: that of the last layer summary"),
    ("gaussian_count", "u64", "Gaussians after the last layer present: that of the last layer summary"),
    ("origin", "f64[3]", "World position of lattice point (0, 0, 0); finite"),
    ("voxel", "f64", "World length of one lattice step; above 0, |origin| + voxel * 2^(lattice_bits + 1) finite"),
    ("source_count", "u64", "Gaussians or anchors in the encoder's input, below 2^53; informative"),
    ("root_crc32", "u32", "CRC-32 of ROOT"),
)

LAYER_SUMMARY = _structure(
    ("anchor_count", "u64", "Anchors after this layer: cumulative, not below the layer before"),
    (
        "gaussian_count",
        "u64",
        "Gaussians after this layer: cumulative, not below the layer before; equal to anchor_count in the explicit"
        " profile, at most anchor_count * slots in the anchor profile",
    ),
    ("byte_count", "u64", "Bytes of all blocks of this layer"),
    ("end_offset", "u64", "Absolute offset one past the last block of this layer"),
    ("stream_bytes", "u64[13]", "Of byte_count, the bytes per stream kind 0..12; their sum is it"),
)

HEADER_CHECKSUM = _structure(
    ("header_crc32", "u32", "CRC-32 of every byte before this field"),
)

SUBSTREAM_RECORD = _structure(
    ("stream", "u8", "Stream kind, 1..11, ascending within the block"),
    ("length", "u32", "Bytes of the sub-stream, a multiple of 4, not 0"),
    ("crc32", "u32", "CRC-32 of the sub-stream"),
)

STRUCTURES: dict[str, Structure] = {
    "FILE_HEADER": FILE_HEADER,
    "LAYER_SUMMARY": LAYER_SUMMARY,
    "HEADER_CHECKSUM": HEADER_CHECKSUM,
    "SUBSTREAM_RECORD": SUBSTREAM_RECORD,
}


def markdown_table(name: str) -> str:
    """The field table of structure `name` as SPEC.md prints it."""
    lines = ["| offset | size | type | field | meaning and range |", "|---:|---:|---|---|---|"]
    lines += [f"| {f.offset} | {f.size} | {f.type} | `{f.name}` | {f.description} |" for f in STRUCTURES[name]]
    return "\n".join(lines) + "\n"


TILE_DTYPE = np.dtype([("depth", "u1"), ("shift", "u1"), ("prefix", "<u8")])
"""A tile in memory: octree depth of its cube, 2^shift lattice steps a cell, Morton code of the cube (SPEC §5.5)."""

ENTRY_DTYPE = np.dtype(
    [
        ("kind", "u1"),
        ("flags", "u1"),
        ("layer", "u1"),
        ("tile", "<u4"),
        ("offset", "<u8"),
        ("length", "<u8"),
        ("count", "<u4"),
        ("crc32", "<u4"),
    ]
)
"""An entry of the directory in memory, as :class:`scarfmt.container.directory.Entry` has it; `tile` may be NO_TILE."""

FILE_HEADER_SIZE = size_of(FILE_HEADER)
LAYER_SUMMARY_SIZE = size_of(LAYER_SUMMARY)
CHECKSUM_SIZE = size_of(HEADER_CHECKSUM)


def header_length(layer_count: int) -> int:
    """Bytes of header, layer summaries and header checksum of a file of `layer_count` layers."""
    return FILE_HEADER_SIZE + layer_count * LAYER_SUMMARY_SIZE + CHECKSUM_SIZE
