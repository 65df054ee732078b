"""Header, tile table, directory and blocks (SPEC §5)."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from scarfmt.container.file import Block, HeaderFields, Tile

SIGNATURE = bytes.fromhex("89534341520d0a1a0a")
VERSION = (0, 1)
NO_TILE = 0xFFFFFFFF
TILE, METADATA = 16, 64
STREAMS, MODELS, FRAMING = 13, 0, 12
CRITICAL, SAFE_TO_COPY = 1, 2

Counts = Sequence[tuple[int, int]]
"""Per layer, cumulative anchors and Gaussians."""


class _Front(NamedTuple):
    """What the header says about what follows it."""

    tiles: bytes
    directory: bytes
    summaries: bytes
    file_length: int


def write_container(
    fields: HeaderFields, tiles: Sequence[Tile], blocks: Iterable[Block], counts: Counts, *, ordered: bool = True
) -> bytes:
    """A file of these blocks: offsets, lengths, summaries and checksums follow from them; no rule is checked.

    Args:
        fields: header fields.
        tiles: tile table, in this order.
        blocks: `stream_bytes` of a TILE block are its sub-streams' lengths; `flags` None are those of R-5.5-3.
        counts: the number of layers follows from it.
        ordered: whether blocks are put in the order of R-5.5-6; if not they stay in the order given.
    """
    chosen = sorted(blocks, key=_key) if ordered else list(blocks)
    table = b"".join(struct.pack("<BBHQ", tile.depth, tile.shift, 0, tile.prefix) for tile in tiles)
    header_length = 104 + 136 * len(counts)
    start = header_length + len(table) + 32 * len(chosen)
    front = _Front(table, _directory(chosen, start), *_summaries(chosen, counts, start))
    header = _header(fields, front, counts)
    payloads = [block.payload for block in chosen]
    return b"".join([header, struct.pack("<I", zlib.crc32(header)), table, front.directory, *payloads])


def _key(block: Block) -> tuple[int, int, int]:
    return block.layer, block.kind, NO_TILE if block.tile is None else block.tile


def _flags(kind: int) -> int:
    return CRITICAL if 1 <= kind <= TILE else SAFE_TO_COPY if kind == METADATA else 0


def _directory(blocks: Sequence[Block], start: int) -> bytes:
    out, offset = [], start
    for block in blocks:
        layer, kind, tile = _key(block)
        flags = _flags(kind) if block.flags is None else block.flags
        size, crc = len(block.payload), zlib.crc32(block.payload)
        out.append(struct.pack("<BBBBIQQII", kind, flags, layer, 0, tile, offset, size, block.count, crc))
        offset += size
    return b"".join(out)


def _summaries(blocks: Sequence[Block], counts: Counts, start: int) -> tuple[bytes, int]:
    """The layer summaries, and the file's length."""
    out, end = [], start
    for layer, (anchors, gaussians) in enumerate(counts, start=1):
        streams = [0] * STREAMS
        for block in blocks:
            if block.layer == layer:
                _count(block, streams)
        end += sum(streams)
        out.append(struct.pack("<17Q", anchors, gaussians, sum(streams), end, *streams))
    return b"".join(out), end


def _count(block: Block, streams: list[int]) -> None:
    if block.kind != TILE:
        streams[MODELS] += len(block.payload)
        return
    for stream, size in block.stream_bytes.items():
        streams[stream] += size
    streams[FRAMING] += len(block.payload) - sum(block.stream_bytes.values())


def _header(fields: HeaderFields, front: _Front, counts: Counts) -> bytes:
    """All of the header but its checksum."""
    anchors, gaussians = counts[-1] if counts else (0, 0)
    layers = len(counts)
    parts = [
        SIGNATURE,
        struct.pack("<BBBIQ", *VERSION, 0, 104 + 136 * layers, front.file_length),
        struct.pack("<4B", fields.profile, fields.sh_degree, layers, fields.slots),
        struct.pack("<4B", fields.lattice_bits, fields.coordinate_frame, fields.colour_space, 0),
        struct.pack("<II", len(front.tiles) // 12, len(front.directory) // 32),
        struct.pack("<QQ", anchors, gaussians),
        struct.pack("<4d", *fields.origin, fields.voxel),
        struct.pack("<QI", fields.source_count, zlib.crc32(front.tiles + front.directory)),
        front.summaries,
    ]
    return b"".join(parts)
