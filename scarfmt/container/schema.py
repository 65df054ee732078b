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
    """A field: byte offset in the structure, byte size, type, name, normative description."""

    offset: int
    size: int
    type: str
    name: str
    description: str


_CODES = {"u8": "B", "u32": "L", "u64": "Q", "f64": "d"}


class Structure:
    """Fields one after the other.

    Args:
        fields: type, name and description of each. ``f64[3]`` is three numbers; ``u8[9]`` is 9 bytes.

    Attributes:
        fields: in file order.
        packed: all of it, for the standard library's `struct`.
    """

    def __init__(self, *fields: tuple[str, str, str]) -> None:
        self.fields: list[Field] = []
        self._packers: dict[str, struct.Struct] = {}
        codes, offset = "<", 0
        for kind, name, description in fields:
            scalar, _, count = kind.rstrip("]").partition("[")
            code = f"{count}s" if scalar == "u8" and count else count + _CODES[scalar]
            self._packers[name] = struct.Struct("<" + code)
            self.fields.append(Field(offset, self._packers[name].size, kind, name, description))
            codes, offset = codes + code, offset + self.fields[-1].size
        self.packed = struct.Struct(codes)

    @property
    def size(self) -> int:
        """Bytes."""
        return self.packed.size

    def value(self, field: Field, data: bytes, at: int = 0) -> Any:
        """A field of the structure that begins at byte `at`: a number, a tuple of them, or bytes."""
        values = self._packers[field.name].unpack_from(data, at + field.offset)
        return values if "[" in field.type and not isinstance(values[0], bytes) else values[0]

    def parse(self, data: bytes, at: int = 0) -> SimpleNamespace:
        """All fields of the structure that begins at byte `at`, by name."""
        return SimpleNamespace(**{field.name: self.value(field, data, at) for field in self.fields})

    def build(self, values: Mapping[str, Any]) -> bytes:
        """The bytes of these values, of which there may be more than fields.

        Raises:
            struct.error: one does not fit its field.
        """
        given = [(packer, values[name]) for name, packer in self._packers.items()]
        return b"".join(packer.pack(*(value if isinstance(value, tuple) else (value,))) for packer, value in given)


FILE_HEADER = Structure(
    (f"u8[{len(SIGNATURE)}]", "signature", "89 53 43 41 52 0D 0A 1A 0A"),
    ("u8", "major", "Version, major: 0. Another major is another format"),
    ("u8", "minor", "Version, minor: 3. While major is 0, another minor is another format"),
    ("u8", "render_model", "How to draw: 0 classic, 1 antialiased, 2 two-dimensional"),
    ("u32", "header_length", "Bytes from the signature through header_crc32: 104 + 136 * layer_count"),
    ("u64", "file_length", "Bytes of the whole file, below 2^53"),
    ("u8", "profile", "Profile: 0 explicit, 1 anchor"),
    ("u8", "sh_degree", "Degree of the decoded spherical harmonics, 0..3; 0 in the anchor profile"),
    ("u8", "layer_count", "Layers in this file, 1..16"),
    ("u8", "slots", "Gaussian slots of an anchor, 1..32; 1 in the explicit profile"),
    ("u8", "lattice_bits", "Bits per axis of the position lattice, 1..32"),
    ("u8", "coordinate_frame", "0 unspecified, 1 RDF (x right, y down, z forward), 2 RUB (x right, y up, z back)"),
    ("u8", "colour_space", "0 unspecified, 1 sRGB display-referred, 2 linear"),
    ("u8", "page_bits", "A page is of 2^page_bits tiles, 0..16"),
    ("u32", "tile_count", "Tiles"),
    ("u32", "root_length", "Bytes of ROOT"),
    ("u64", "anchor_count", "Anchors after the last layer present: that of the last layer summary"),
    ("u64", "gaussian_count", "Gaussians after the last layer present: that of the last layer summary"),
    ("f64[3]", "origin", "World position of lattice point (0, 0, 0); finite"),
    ("f64", "voxel", "World length of one lattice step; above 0, |origin| + voxel * 2^(lattice_bits + 1) finite"),
    ("u64", "source_count", "Gaussians or anchors in the encoder's input, below 2^53; informative"),
    ("u32", "root_crc32", "CRC-32 of ROOT"),
)

LAYER_SUMMARY = Structure(
    ("u64", "anchor_count", "Anchors after this layer: cumulative, not below the layer before"),
    (
        "u64",
        "gaussian_count",
        "Gaussians after this layer: cumulative, not below the layer before; equal to anchor_count in the explicit"
        " profile, at most anchor_count * slots in the anchor profile",
    ),
    ("u64", "byte_count", "Bytes of all blocks of this layer"),
    ("u64", "end_offset", "Absolute offset one past the last block of this layer"),
    (f"u64[{STREAM_COUNT}]", "stream_bytes", "Of byte_count, the bytes per stream kind 0..12; their sum is it"),
)

HEADER_CHECKSUM = Structure(
    ("u32", "header_crc32", "CRC-32 of every byte before this field"),
)

SUBSTREAM_RECORD = Structure(
    ("u8", "stream", "Stream kind, 1..11, ascending within the block"),
    ("u32", "length", "Bytes of the sub-stream, a multiple of 4, not 0"),
    ("u32", "crc32", "CRC-32 of the sub-stream"),
)

STRUCTURES = {
    "FILE_HEADER": FILE_HEADER,
    "LAYER_SUMMARY": LAYER_SUMMARY,
    "HEADER_CHECKSUM": HEADER_CHECKSUM,
    "SUBSTREAM_RECORD": SUBSTREAM_RECORD,
}

def markdown_table(name: str) -> str:
    """The field table of structure `name` as SPEC.md prints it."""
    lines = ["| offset | size | type | field | meaning and range |", "|---:|---:|---|---|---|"]
    lines += [f"| {f.offset} | {f.size} | {f.type} | `{f.name}` | {f.description} |" for f in STRUCTURES[name].fields]
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

FILE_HEADER_SIZE = FILE_HEADER.size
LAYER_SUMMARY_SIZE = LAYER_SUMMARY.size
CHECKSUM_SIZE = HEADER_CHECKSUM.size


def header_length(layer_count: int) -> int:
    """Bytes of header, layer summaries and header checksum of a file of `layer_count` layers."""
    return FILE_HEADER_SIZE + layer_count * LAYER_SUMMARY_SIZE + CHECKSUM_SIZE
