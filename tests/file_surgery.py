"""Taking whole files apart and putting them together again, checksums right, for tests of damaged files."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from scarfmt.container import Block, Container, write_container
from scarfmt.inspection import read_metadata
from scarfmt.limits import DEFAULT_LIMITS, Limits
from scarfmt.reader import SceneReader
from scarfmt.schema import (
    CHECKSUM_SIZE,
    DIRECTORY_ENTRY,
    FILE_HEADER,
    FILE_HEADER_SIZE,
    SUBSTREAM_RECORD,
    TILE_RECORD,
    BlockKind,
    Stream,
)
from scarfmt.source import BytesSource
from scarfmt.substreams import RECORD_SIZE
from scarfmt.tile import TileContent

Contents = list[TileContent]


def same_content(a: TileContent, b: TileContent) -> bool:
    """Whether two tiles hold the same integers, in the same types."""
    return all(
        x.dtype == y.dtype and np.array_equal(x, y) for x, y in zip(arrays_of(a), arrays_of(b), strict=True)
    )


def arrays_of(tile: TileContent) -> list[NDArray[np.generic]]:
    """All arrays of a tile."""
    return [tile.codes, tile.classes, tile.indices, tile.slot_layers, *tile.values, *tile.first]


def read_everything(data: bytes, limits: Limits = DEFAULT_LIMITS) -> Contents:
    """All a reader can read of a file: metadata, models, tiles."""
    reader = SceneReader(BytesSource(data), limits=limits)
    read_metadata(reader.container)
    return [content for _, content in reader.tiles(reader.models())]


def blocks_of(data: bytes) -> list[Block]:
    """All blocks of a sound file; bytes of sub-streams are not kept apart."""
    container = Container.open(BytesSource(data))
    pairs = container.read_blocks(container.entries)
    return [Block(e.kind, e.layer, payload, e.tile, e.count, {}, e.flags) for e, payload in pairs]


def rebuilt(data: bytes, blocks: Iterable[Block]) -> bytes:
    """The file with other blocks, everything about them recomputed."""
    container = Container.open(BytesSource(data))
    counts = [(layer.anchor_count, layer.gaussian_count) for layer in container.header.layers]
    return write_container(container.header.fields, container.tiles, blocks, counts)


def without(data: bytes, unwanted: Callable[[Block], bool]) -> bytes:
    """The file without the blocks chosen."""
    return rebuilt(data, [block for block in blocks_of(data) if not unwanted(block)])


def resealed_tile(payload: bytes) -> bytes:
    """A TILE block with all its checksums made right, as far as its table makes sense."""
    out = bytearray(payload)
    size = 1 + RECORD_SIZE * payload[0]
    if size + 4 > len(out):
        return payload
    at = size + 4
    for start in range(1, size, RECORD_SIZE):
        length = SUBSTREAM_RECORD.parse(bytes(out[start : start + RECORD_SIZE])).length
        crc = zlib.crc32(out[at : at + length])
        out[start + RECORD_SIZE - 4 : start + RECORD_SIZE] = crc.to_bytes(4, "little")
        at += length
    out[size : size + 4] = zlib.crc32(out[:size]).to_bytes(4, "little")
    return bytes(out)


def resealed(data: bytes) -> bytes:
    """The file with the checksums of sub-streams, blocks, directory and header made right where they can be found."""
    out = bytearray(data)
    front = FILE_HEADER.parse(data[:FILE_HEADER_SIZE])
    directory = front.header_length + TILE_RECORD.sizeof() * front.tile_count
    size = DIRECTORY_ENTRY.sizeof()
    end = directory + size * front.entry_count
    if FILE_HEADER_SIZE + CHECKSUM_SIZE <= front.header_length <= end <= len(out):
        for start in range(directory, end, size):
            entry = DIRECTORY_ENTRY.parse(bytes(out[start : start + size]))
            past = entry.offset + entry.length
            if entry.length and end <= entry.offset and past <= len(out):
                if entry.kind == BlockKind.TILE:
                    out[entry.offset : past] = resealed_tile(bytes(out[entry.offset : past]))
                out[start + size - 4 : start + size] = zlib.crc32(out[entry.offset : past]).to_bytes(4, "little")
        place = FILE_HEADER_SIZE - 4
        out[place : place + 4] = zlib.crc32(out[front.header_length : end]).to_bytes(4, "little")
        crc = front.header_length - CHECKSUM_SIZE
        out[crc : crc + 4] = zlib.crc32(out[:crc]).to_bytes(4, "little")
    return bytes(out)


ATTRIBUTES = frozenset(Stream) - {Stream.MODELS, Stream.FRAMING, Stream.POSITIONS, Stream.CLASSES, Stream.MASKS}
"""Streams a caller may leave out."""
