"""Whole files for the vectors, and faults put in with all checksums right."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable
from dataclasses import replace

from conformance.writer import FrameStyle, WriteOptions, write_container, write_file
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.bytefields import decompress
from scarfmt.container.file import Block, Container
from scarfmt.container.schema import CHECKSUM_SIZE, FILE_HEADER, FILE_HEADER_SIZE, BlockKind, Stream, field_table
from scarfmt.container.source import BytesSource
from scarfmt.container.substreams import unpack_table
from scarfmt.limits import FORMAT_LIMITS

COMPRESSED = (BlockKind.TABLES, BlockKind.DECODER_MLP, BlockKind.SCENE_MLP)
_PLAIN = WriteOptions()


def stored_frame(content: bytes) -> bytes:
    """One single-segment Zstandard frame of raw blocks (RFC 8878): the same with every version of libzstd."""
    return FrameStyle()(content)


def content_of(block: Block) -> bytes:
    """The content of a compressed model block."""
    return decompress(block.payload, 1 << 26, "vector")


def blocks_of(data: bytes) -> list[Block]:
    """All blocks of a sound file, with the bytes each sub-stream takes."""
    container = Container.open(BytesSource(data), limits=FORMAT_LIMITS)
    out = []
    for entry, payload in container.read_blocks(container.entries):
        streams: dict[int, int] = {}
        if entry.kind == BlockKind.TILE:
            streams = {int(kind): part.length for kind, part in unpack_table(payload, len(payload)).items()}
        out.append(Block(entry.kind, entry.layer, payload, entry.tile, entry.count, streams, entry.flags))
    return out


def rebuilt(data: bytes, blocks: Iterable[Block]) -> bytes:
    """The file with other blocks, everything about them recomputed."""
    container = Container.open(BytesSource(data), limits=FORMAT_LIMITS)
    counts = [(layer.anchor_count, layer.gaussian_count) for layer in container.header.layers]
    return write_container(container.header.fields, container.tiles, blocks, counts)


def vector_file(scene: QuantisedScene, extra: Iterable[Block] = (), options: WriteOptions = _PLAIN) -> bytes:
    """The file of a scene, by the writer of the suite; `extra` blocks are added."""
    return write_file(scene, replace(options, blocks=(*options.blocks, *extra)))


def changed(data: bytes, kind: BlockKind, layer: int, change: Callable[[bytes], bytes], count: int = 0) -> bytes:
    """The file with the first block of `kind` in `layer` changed, lengths and checksums right.

    Compressed blocks are changed inside their frame. `count` is added to the block's count.
    """
    blocks = blocks_of(data)
    row = next(i for i, block in enumerate(blocks) if (block.kind, block.layer) == (kind, layer))
    old = blocks[row]
    payload = stored_frame(change(content_of(old))) if kind in COMPRESSED else change(old.payload)
    blocks[row] = replace(old, payload=payload, count=old.count + count, stream_bytes=_streams(old, payload))
    return rebuilt(data, blocks)


def _streams(block: Block, payload: bytes) -> dict[int, int]:
    if block.kind != BlockKind.TILE:
        return {}
    return {int(kind): part.length for kind, part in unpack_table(payload, len(payload)).items()}


def resealed_front(data: bytes | bytearray) -> bytes:
    """The file with the checksums of directory and header made right."""
    out = bytearray(data)
    front = FILE_HEADER.parse(bytes(out[:FILE_HEADER_SIZE]))
    end = front.header_length + 12 * front.tile_count + 32 * front.entry_count
    place = next(row.offset for row in field_table(FILE_HEADER) if row.name == "directory_crc32")
    out[place : place + 4] = zlib.crc32(out[front.header_length : end]).to_bytes(4, "little")
    crc = front.header_length - CHECKSUM_SIZE
    out[crc : crc + 4] = zlib.crc32(out[:crc]).to_bytes(4, "little")
    return bytes(out)


def patched(data: bytes, structure: object, start: int, field: str, value: int) -> bytes:
    """The file with one integer field of a structure at `start` changed, front checksums right."""
    row = next(row for row in field_table(structure) if row.name == field)
    out = bytearray(data)
    out[start + row.offset : start + row.offset + row.size] = value.to_bytes(row.size, "little")
    return resealed_front(out)


def without(data: bytes, kind: BlockKind, layer: int) -> bytes:
    """The file without its blocks of `kind` in `layer`."""
    return rebuilt(data, [block for block in blocks_of(data) if (block.kind, block.layer) != (kind, layer)])


def tile_parts(payload: bytes) -> dict[Stream, bytes]:
    """The sub-streams of a TILE block."""
    table = unpack_table(payload, len(payload))
    return {kind: payload[part.start : part.start + part.length] for kind, part in table.items()}


def substream_bytes(data: bytes, kind: Stream, layer: int) -> tuple[int, int]:
    """Start and past of a sub-stream of the first TILE block of `layer`, absolute."""
    container = Container.open(BytesSource(data), limits=FORMAT_LIMITS)
    for entry in container.entries:
        if (entry.kind, entry.layer) == (BlockKind.TILE, layer):
            part = unpack_table(container.read_block(entry), entry.length)[kind]
            return entry.offset + part.start, entry.offset + part.start + part.length
    raise LookupError(kind)
