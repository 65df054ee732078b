"""Header, ROOT, pages and blocks (SPEC §5)."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from conformance.writer.pages import PAGE_BITS, TILE, ModelRow, TileRow, paged
from scarfmt.container.file import Block, HeaderFields, Tile

SIGNATURE = bytes.fromhex("89534341520d0a1a0a")
VERSION = (0, 3)
THUMBNAIL = 15
METADATA = 64
STREAMS, MODELS, FRAMING = 13, 0, 12
CRITICAL, SAFE_TO_COPY = 1, 2

Counts = Sequence[tuple[int, int]]
"""Per layer, cumulative anchors and Gaussians."""


class _Front(NamedTuple):
    """The header fields about what follows the header."""

    tile_count: int
    page_bits: int
    root: bytes
    summaries: bytes
    file_length: int


def write_container(
    fields: HeaderFields,
    tiles: Sequence[Tile],
    blocks: Iterable[Block],
    counts: Counts,
    *,
    page_bits: int = PAGE_BITS,
) -> bytes:
    """A file of these blocks: offsets, lengths, sums, summaries and checksums follow from them; no rule is checked.

    Args:
        fields: header fields.
        tiles: ascending and disjoint, as nothing else can be said.
        blocks: of layers that there are; at most one TILE block a layer and tile. `stream_bytes` of one are its
            sub-streams' lengths; `flags` None are those of R-5.4-5.
        counts: the number of layers follows from it.
        page_bits: a page has 2^page_bits tiles.
    """
    chosen = sorted(blocks, key=_key)
    layers = range(1, len(counts) + 1)
    models = [[_model_row(b) for b in chosen if b.layer == layer and b.kind != TILE] for layer in layers]
    cubes = [(tile.depth, tile.shift, tile.prefix) for tile in tiles]
    pages = paged(cubes, models, [_tile_row(block) for block in chosen if block.kind == TILE], page_bits)
    root, paged_bytes = pages.root.packed(), pages.packed_pages()
    start = 104 + 136 * len(counts) + len(root) + len(paged_bytes)
    header = _header(fields, _Front(len(tiles), page_bits, root, *_summaries(chosen, counts, start)), counts)
    payloads = [block.payload for block in chosen]
    return b"".join([header, struct.pack("<I", zlib.crc32(header)), root, paged_bytes, *payloads])


def _key(block: Block) -> tuple[int, int, int]:
    return block.layer, block.kind, block.tile or 0


def _flags(block: Block) -> int:
    if block.flags is not None:
        return block.flags
    if block.kind in (THUMBNAIL, METADATA):
        return SAFE_TO_COPY
    return CRITICAL if 1 <= block.kind <= TILE else 0


def _model_row(block: Block) -> ModelRow:
    size, crc = len(block.payload), zlib.crc32(block.payload)
    return ModelRow(block.kind, _flags(block), size, block.count, crc)


def _tile_row(block: Block) -> TileRow:
    if block.tile is None:
        raise ValueError("a TILE block of no tile")
    return TileRow(block.layer, block.tile, len(block.payload), block.count, zlib.crc32(block.payload))


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
    """The header without its checksum."""
    anchors, gaussians = counts[-1] if counts else (0, 0)
    layers = len(counts)
    parts = [
        SIGNATURE,
        struct.pack("<BBBIQ", *VERSION, fields.render_model, 104 + 136 * layers, front.file_length),
        struct.pack("<4B", fields.profile, fields.sh_degree, layers, fields.slots),
        struct.pack("<4B", fields.lattice_bits, fields.coordinate_frame, fields.colour_space, front.page_bits),
        struct.pack("<II", front.tile_count, len(front.root)),
        struct.pack("<QQ", anchors, gaussians),
        struct.pack("<4d", *fields.origin, fields.voxel),
        struct.pack("<QI", fields.source_count, zlib.crc32(front.root)),
        front.summaries,
    ]
    return b"".join(parts)
