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

The docstring of a field (construct's ``* "..."``) is normative: SPEC.md's tables are made from it, and error
messages quote it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from construct import Array, Bytes, Float64l, FormatField, Int8ul, Int32ul, Int64ul, Renamed, Struct

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

FILE_HEADER: Any = Struct(
    "signature" / Bytes(len(SIGNATURE)) * "89 53 43 41 52 0D 0A 1A 0A",
    "major" / Int8ul * "Version, major: 0. Another major is another format",
    "minor" / Int8ul * "Version, minor: 3. While major is 0, another minor is another format",
    "render_model" / Int8ul * "How to draw: 0 classic, 1 antialiased, 2 two-dimensional",
    "header_length" / Int32ul * "Bytes from the signature through header_crc32: 104 + 136 * layer_count",
    "file_length" / Int64ul * "Bytes of the whole file, below 2^53",
    "profile" / Int8ul * "Profile: 0 explicit, 1 anchor",
    "sh_degree" / Int8ul * "Degree of the decoded spherical harmonics, 0..3; 0 in the anchor profile",
    "layer_count" / Int8ul * "Layers in this file, 1..16",
    "slots" / Int8ul * "Gaussian slots of an anchor, 1..32; 1 in the explicit profile",
    "lattice_bits" / Int8ul * "Bits per axis of the position lattice, 1..32",
    "coordinate_frame" / Int8ul * "0 unspecified, 1 RDF (x right, y down, z forward), 2 RUB (x right, y up, z back)",
    "colour_space" / Int8ul * "0 unspecified, 1 sRGB display-referred, 2 linear",
    "page_bits" / Int8ul * "A page is of 2^page_bits tiles, 0..16",
    "tile_count" / Int32ul * "Tiles",
    "root_length" / Int32ul * "Bytes of ROOT",
    "anchor_count" / Int64ul * "Anchors after the last layer present: that of the last layer summary",
    "gaussian_count" / Int64ul * "Gaussians after the last layer present: that of the last layer summary",
    "origin" / Array(3, Float64l) * "World position of lattice point (0, 0, 0); finite",
    "voxel" / Float64l * "World length of one lattice step; above 0, |origin| + voxel * 2^(lattice_bits + 1) finite",
    "source_count" / Int64ul * "Gaussians or anchors in the encoder's input, below 2^53; informative",
    "root_crc32" / Int32ul * "CRC-32 of ROOT",
)

LAYER_SUMMARY: Any = Struct(
    "anchor_count" / Int64ul * "Anchors after this layer: cumulative, not below the layer before",
    "gaussian_count"
    / Int64ul
    * (
        "Gaussians after this layer: cumulative, not below the layer before; equal to anchor_count in the explicit"
        " profile, at most anchor_count * slots in the anchor profile"
    ),
    "byte_count" / Int64ul * "Bytes of all blocks of this layer",
    "end_offset" / Int64ul * "Absolute offset one past the last block of this layer",
    "stream_bytes" / Array(STREAM_COUNT, Int64ul) * "Of byte_count, the bytes per stream kind 0..12; their sum is it",
)

HEADER_CHECKSUM: Any = Struct("header_crc32" / Int32ul * "CRC-32 of every byte before this field")

SUBSTREAM_RECORD: Any = Struct(
    "stream" / Int8ul * "Stream kind, 1..11, ascending within the block",
    "length" / Int32ul * "Bytes of the sub-stream, a multiple of 4, not 0",
    "crc32" / Int32ul * "CRC-32 of the sub-stream",
)

STRUCTURES: dict[str, Any] = {
    "FILE_HEADER": FILE_HEADER,
    "LAYER_SUMMARY": LAYER_SUMMARY,
    "HEADER_CHECKSUM": HEADER_CHECKSUM,
    "SUBSTREAM_RECORD": SUBSTREAM_RECORD,
}

_SCALARS = {"<B": ("u8", "<u1"), "<H": ("u16", "<u2"), "<L": ("u32", "<u4"), "<Q": ("u64", "<u8"), "<d": ("f64", "<f8")}


class Field(NamedTuple):
    """One row of a field table: byte offset in the structure, byte size, type, name, normative description."""

    offset: int
    size: int
    type: str
    name: str
    description: str


def _strip_names(member: Any) -> Any:
    while isinstance(member, Renamed):
        member = member.subcon
    return member


def _field_type(member: Any) -> str:
    subcon = _strip_names(member)
    if isinstance(subcon, FormatField):
        return _SCALARS[subcon.fmtstr][0]
    if isinstance(subcon, Array):
        return f"{_field_type(subcon.subcon)}[{subcon.count}]"
    return f"u8[{subcon.sizeof()}]"


def field_table(structure: Any) -> list[Field]:
    """The fields of one construct Struct of this module, in file order."""
    rows: list[Field] = []
    offset = 0
    for member in structure.subcons:
        size = member.sizeof()
        rows.append(Field(offset, size, _field_type(member), member.name, member.docs))
        offset += size
    return rows


def markdown_table(name: str) -> str:
    """The field table of structure `name` as SPEC.md prints it."""
    lines = ["| offset | size | type | field | meaning and range |", "|---:|---:|---|---|---|"]
    fields = field_table(STRUCTURES[name])
    lines += [f"| {f.offset} | {f.size} | {f.type} | `{f.name}` | {f.description} |" for f in fields]
    return "\n".join(lines) + "\n"


def numpy_dtype(structure: Any) -> np.dtype[np.void]:
    """The packed numpy dtype of a Struct of scalars: large tables are parsed with it, at once."""
    return np.dtype([(member.name, _SCALARS[_strip_names(member).fmtstr][1]) for member in structure.subcons])


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

FILE_HEADER_SIZE: int = FILE_HEADER.sizeof()
LAYER_SUMMARY_SIZE: int = LAYER_SUMMARY.sizeof()
CHECKSUM_SIZE: int = HEADER_CHECKSUM.sizeof()
