"""Small containers, strategies for random ones, and byte surgery, shared by the container tests."""

from __future__ import annotations

import struct
import zlib

from scarfmt.container.file import PAGE_BITS, Block, HeaderFields, Tile, write_container
from scarfmt.container.schema import (
    CHECKSUM_SIZE,
    FILE_HEADER_SIZE,
    STRUCTURES,
    BlockFlag,
    BlockKind,
    ColourSpace,
    CoordinateFrame,
    Profile,
    Stream,
    field_table,
)

FIELDS = HeaderFields(Profile.EXPLICIT, 3, 1, 24, (-1.5, 0.0, 2.25), 0.001, 120, CoordinateFrame.RDF, ColourSpace.SRGB)
TILES = [Tile(1, 2, 0), Tile(2, 3, 8), Tile(1, 2, 5)]
COUNTS = [(10, 10), (25, 25), (100, 100)]


def sample_blocks() -> list[Block]:
    """Blocks of three layers, in file order."""
    return [
        Block(BlockKind.LAYER, 1, b"first layer"),
        Block(BlockKind.CODEBOOKS, 1, b"codewords"),
        Block(BlockKind.TILE, 1, b"tile zero", 0, 7, {Stream.POSITIONS: 4, Stream.INDICES: 2}),
        Block(BlockKind.TILE, 1, b"tile two", 2, 3, {Stream.POSITIONS: 3}),
        Block(BlockKind.METADATA, 1, b'{"title": "sample"}'),
        Block(BlockKind.LAYER, 2, b"second layer"),
        Block(BlockKind.TILE, 2, b"more of zero", 0, 0, {Stream.INDICES: 12}),
        Block(BlockKind.TILE, 2, b"one appears", 1, 15, {Stream.SCALE: 5}),
        Block(BlockKind.LAYER, 3, b"third"),
        Block(BlockKind.TILE, 3, b"one again", 1, 75, {Stream.COLOUR: 9}),
        Block(200, 3, b"private", count=4, flags=BlockFlag.SAFE_TO_COPY),
    ]


def sample_file(layers: int = 3, page_bits: int = PAGE_BITS) -> bytes:
    """The container of the first `layers` layers of :func:`sample_blocks`."""
    blocks = [block for block in sample_blocks() if block.layer <= layers]
    return write_container(FIELDS, TILES, blocks, COUNTS[:layers], page_bits)


_STARTS = {"FILE_HEADER": 0, "LAYER_SUMMARY": FILE_HEADER_SIZE}


def locate(name: str, row: int, field: str, index: int = 0) -> tuple[int, str]:
    """Absolute offset and struct code of a (possibly array) field of FILE_HEADER or of a LAYER_SUMMARY."""
    place = next(f for f in field_table(STRUCTURES[name]) if f.name == field)
    code = {"u8": "B", "u16": "H", "u32": "I", "u64": "Q", "f64": "d"}[place.type.split("[")[0]]
    start = _STARTS[name] + row * STRUCTURES[name].sizeof() + place.offset
    return start + index * struct.calcsize("<" + code), "<" + code


def get(data: bytes, name: str, row: int, field: str, index: int = 0) -> int:
    """A field's value."""
    offset, code = locate(name, row, field, index)
    return struct.unpack_from(code, data, offset)[0]


def edit(data: bytes, name: str, row: int, field: str, value: float, index: int = 0) -> bytes:
    """`data` with one field of the header changed and the header's checksum made right again."""
    offset, code = locate(name, row, field, index)
    changed = bytearray(data)
    struct.pack_into(code, changed, offset, value)
    return refit(bytes(changed), int.from_bytes(data[12:16], "little"), int.from_bytes(data[36:40], "little"))


def refit(data: bytes, header_length: int, root_length: int) -> bytes:
    """`data` with the checksums of ROOT and header recomputed, for a header and a ROOT of these lengths."""
    changed = bytearray(data)
    changed[96:100] = zlib.crc32(changed[header_length : header_length + root_length]).to_bytes(4, "little")
    end = header_length - CHECKSUM_SIZE
    changed[end:header_length] = zlib.crc32(changed[:end]).to_bytes(4, "little")
    return bytes(changed)
