"""A file as its parts, to be changed and put together again with right lengths and checksums (SPEC §5).

Nothing is checked: any field may be made wrong. Only the parts of a sound file can be taken.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field, replace
from functools import lru_cache

from scarfmt.container.schema import (
    CHECKSUM_SIZE,
    DIRECTORY_ENTRY,
    FILE_HEADER_SIZE,
    LAYER_SUMMARY_SIZE,
    SIGNATURE,
    STREAM_COUNT,
    SUBSTREAM_RECORD,
    TILE_RECORD,
    BlockKind,
    Stream,
    header_length,
)

ENTRY = struct.Struct("<BBBBIQQII")
RECORD = struct.Struct("<BII")
_COUNTS = struct.Struct("<QQ")
_SUMMARY = struct.Struct(f"<{4 + STREAM_COUNT}Q")
TILE_SIZE: int = TILE_RECORD.sizeof()
ENTRY_SIZE: int = DIRECTORY_ENTRY.sizeof()
RECORD_SIZE: int = SUBSTREAM_RECORD.sizeof()
_CRC = struct.Struct("<I")
# Offsets in FILE_HEADER of what is computed.
_HEADER_LENGTH, _FILE_LENGTH, _LAYER_COUNT, _TABLES, _ANCHORS, _DIRECTORY_CRC = 12, 16, 26, 32, 40, 96


@dataclass
class Part:
    """A block and its directory entry; offset, length and crc32 are computed."""

    kind: int
    flags: int
    layer: int
    reserved: int
    tile: int
    count: int
    payload: bytes


@dataclass
class Parts:
    """A file taken apart.

    Attributes:
        header: FILE_HEADER; lengths, counts and checksum in it are computed.
        gaussians: per layer, cumulative Gaussians as the file declared them.
        tiles: TILE_RECORDs.
        blocks: in file order.
    """

    header: bytes
    gaussians: list[int]
    tiles: list[bytes]
    blocks: list[Part] = field(default_factory=list)

    def copy(self) -> Parts:
        """A copy whose lists and blocks may be changed."""
        return Parts(self.header, list(self.gaussians), list(self.tiles), [replace(block) for block in self.blocks])


@lru_cache(maxsize=512)
def _parts_of(data: bytes) -> Parts:
    layers = data[_LAYER_COUNT]
    tile_count, entry_count = struct.unpack_from("<II", data, _TABLES)
    at = header_length(layers)
    if at + TILE_SIZE * tile_count + ENTRY_SIZE * entry_count > len(data):
        raise ValueError("the tables are longer than the file")
    tiles = [data[at + TILE_SIZE * i : at + TILE_SIZE * (i + 1)] for i in range(tile_count)]
    at += TILE_SIZE * tile_count
    blocks = []
    for index in range(entry_count):
        kind, flags, layer, reserved, tile, offset, length, count, _ = ENTRY.unpack_from(data, at + ENTRY_SIZE * index)
        blocks.append(Part(kind, flags, layer, reserved, tile, count, data[offset : offset + length]))
    gaussians = [
        _COUNTS.unpack_from(data, FILE_HEADER_SIZE + LAYER_SUMMARY_SIZE * layer)[1] for layer in range(layers)
    ]
    return Parts(data[:FILE_HEADER_SIZE], gaussians, tiles, blocks)


def take_apart(data: bytes) -> Parts:
    """The parts of a sound file, the caller's own.

    Raises:
        ValueError: the file is shorter than its tables.
    """
    return _parts_of(data).copy()


def put_together(parts: Parts) -> bytes:
    """A file of these parts: counts of anchors, lengths, offsets and checksums follow from them."""
    layers = len(parts.gaussians)
    start = header_length(layers) + TILE_SIZE * len(parts.tiles) + ENTRY_SIZE * len(parts.blocks)
    streams = [[0] * STREAM_COUNT for _ in range(layers)]
    new = [0] * layers
    entries, at = [], start
    for block in parts.blocks:
        size = len(block.payload)
        crc = zlib.crc32(block.payload)
        entries.append(
            ENTRY.pack(
                block.kind, block.flags, block.layer, block.reserved, block.tile, at, size, block.count, crc
            )
        )
        at += size
        if 1 <= block.layer <= layers:
            _count(streams[block.layer - 1], block)
            new[block.layer - 1] += block.count if block.kind == BlockKind.TILE else 0
    tables = b"".join(parts.tiles) + b"".join(entries)
    return _front(parts, streams, new, tables, start) + b"".join(block.payload for block in parts.blocks)


def _count(streams: list[int], block: Part) -> None:
    """Add a block to the bytes per stream kind of its layer."""
    if block.kind != BlockKind.TILE:
        streams[Stream.MODELS] += len(block.payload)
        return
    rest = len(block.payload)
    for kind, length, _ in records(block.payload):
        if Stream.MODELS < kind < Stream.FRAMING and length <= rest:
            streams[kind] += length
            rest -= length
    streams[Stream.FRAMING] += rest


def records(payload: bytes) -> list[tuple[int, int, int]]:
    """(stream, length, crc32) of the sub-stream records that a TILE block has room for."""
    count = min(payload[0], (len(payload) - 1) // RECORD_SIZE) if payload else 0
    return [RECORD.unpack_from(payload, 1 + RECORD_SIZE * index) for index in range(count)]


def _front(parts: Parts, streams: list[list[int]], new: list[int], tables: bytes, start: int) -> bytes:
    layers = len(streams)
    header = bytearray(parts.header)
    explicit, slots = header[24] == 0, header[27]
    summaries, anchors, gaussians, end = [], 0, 0, start
    for counts, more, declared in zip(streams, new, parts.gaussians, strict=True):
        anchors += more
        gaussians = anchors if explicit else max(gaussians, min(declared, anchors * slots))
        size = sum(counts)
        end += size
        summaries.append(_SUMMARY.pack(anchors, gaussians, size, end, *counts))
    struct.pack_into("<IQ", header, _HEADER_LENGTH, header_length(layers), end)
    header[_LAYER_COUNT] = layers
    struct.pack_into("<II", header, _TABLES, len(parts.tiles), len(parts.blocks))
    struct.pack_into("<QQ", header, _ANCHORS, anchors, gaussians)
    _CRC.pack_into(header, _DIRECTORY_CRC, zlib.crc32(tables))
    front = bytes(header) + b"".join(summaries)
    return front + _CRC.pack(zlib.crc32(front)) + tables


def resealed_tile(payload: bytes) -> bytes:
    """A TILE block with all its checksums made right, as far as its table makes sense."""
    if not payload:
        return payload
    size = 1 + RECORD_SIZE * payload[0]
    if size + 4 > len(payload):
        return payload
    out = bytearray(payload)
    at = size + 4
    for start in range(1, size, RECORD_SIZE):
        length = RECORD.unpack_from(out, start)[1]
        _CRC.pack_into(out, start + RECORD_SIZE - 4, zlib.crc32(out[at : at + length]))
        at += length
    _CRC.pack_into(out, size, zlib.crc32(out[:size]))
    return bytes(out)


def resealed(data: bytes) -> bytes:
    """The file with the checksums of sub-streams, blocks, directory and header made right where they can be found."""
    if len(data) < FILE_HEADER_SIZE + CHECKSUM_SIZE:
        return data
    out = bytearray(data)
    (length,) = struct.unpack_from("<I", out, _HEADER_LENGTH)
    tile_count, entry_count = struct.unpack_from("<II", out, _TABLES)
    directory = length + TILE_SIZE * tile_count
    end = directory + ENTRY_SIZE * entry_count
    if FILE_HEADER_SIZE + CHECKSUM_SIZE <= length <= end <= len(out):
        for start in range(directory, end, ENTRY_SIZE):
            _reseal_block(out, start, end)
        _CRC.pack_into(out, _DIRECTORY_CRC, zlib.crc32(out[length:end]))
    if FILE_HEADER_SIZE + CHECKSUM_SIZE <= length <= len(out):
        _CRC.pack_into(out, length - CHECKSUM_SIZE, zlib.crc32(out[: length - CHECKSUM_SIZE]))
    return bytes(out)


def _reseal_block(out: bytearray, entry: int, first: int) -> None:
    kind, _, _, _, _, offset, length, _, _ = ENTRY.unpack_from(out, entry)
    past = offset + length
    if not (length and first <= offset and past <= len(out)):
        return
    if kind == BlockKind.TILE:
        out[offset:past] = resealed_tile(bytes(out[offset:past]))
    _CRC.pack_into(out, entry + ENTRY_SIZE - 4, zlib.crc32(out[offset:past]))


def is_file(data: bytes) -> bool:
    """Whether the bytes start like a file of this version: what :func:`take_apart` needs, and no more."""
    return len(data) >= header_length(1) and data.startswith(SIGNATURE)
