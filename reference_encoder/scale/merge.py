"""The file of a scene from its ranges: front, models, then of each layer the blocks of all ranges in Morton order.

Nothing is decoded, and no more is held than the directory and a piece of a range.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import BinaryIO

import numpy as np

from reference_encoder.scale.steps import Models
from reference_encoder.scale.tasks import Rows, numbered
from reference_encoder.scale.work import Work
from scarfmt.container.directory import Table, tile_table
from scarfmt.container.file import Block, HeaderFields, directory_row, encode_front
from scarfmt.container.schema import ENTRY_DTYPE, STREAM_COUNT, BlockFlag, BlockKind, Stream
from scarfmt.container.source import opened

PIECE_BYTES = 1 << 22
"""Bytes that are copied at once."""


def write_file(work: Work, fields: HeaderFields, models: Models, ranges: Sequence[Rows], target: BinaryIO) -> int:
    """Write the file whose blocks are in a work directory.

    Args:
        work: with the segments of all ranges.
        fields: of the header.
        models: their blocks, and how many anchors each layer has.
        ranges: what the directory says of the blocks of each range, in Morton order.
        target: opened for writing in binary mode.

    Returns:
        Bytes written.

    Raises:
        InvalidInput: ``input-container``: the file would break a rule.
    """
    tiles = tile_table([tile for rows in ranges for tile in rows.tiles])
    before, after = _by_layer(models, BlockKind.TILE, below=True), _by_layer(models, BlockKind.TILE, below=False)
    directory = [part for layer in range(len(models.anchors)) for part in _rows(layer, before, ranges, after)]
    counts = [(int(anchors), int(anchors)) for anchors in models.anchors]
    streams = [_streams(layer, [*before[layer], *after[layer]], ranges) for layer in range(len(counts))]
    written = target.write(encode_front(fields, tiles, np.concatenate(directory), counts, streams))
    for layer in range(len(counts)):
        written += sum(target.write(block.payload) for block in before[layer])
        for number, rows in enumerate(ranges):
            written += sum(target.write(piece) for piece in _pieces(work, number, rows, layer))
        written += sum(target.write(block.payload) for block in after[layer])
    return written


def _by_layer(models: Models, kind: int, below: bool) -> list[list[Block]]:
    """The blocks of each layer that come before those of its tiles, or after."""
    chosen = [block for block in models.blocks if (block.kind < kind) == below]
    return [[block for block in chosen if block.layer == layer + 1] for layer in range(len(models.anchors))]


def _rows(
    layer: int, before: list[list[Block]], ranges: Sequence[Rows], after: list[list[Block]]
) -> Iterator[Table]:
    """Rows of the directory of one layer."""
    yield np.array([directory_row(block) for block in before[layer]], ENTRY_DTYPE)
    first = 0
    for rows in ranges:
        own = rows.layers[layer]
        table = np.zeros(len(own.tiles), ENTRY_DTYPE)
        table["kind"], table["flags"], table["layer"] = BlockKind.TILE, BlockFlag.CRITICAL, layer + 1
        table["tile"], table["length"] = first + own.tiles, own.lengths
        table["count"], table["crc32"] = own.counts, own.checksums
        first += len(rows.tiles)
        yield table
    yield np.array([directory_row(block) for block in after[layer]], ENTRY_DTYPE)


def _streams(layer: int, blocks: Sequence[Block], ranges: Sequence[Rows]) -> list[int]:
    """Bytes of each kind of stream in a layer."""
    sizes = np.zeros(STREAM_COUNT, np.int64)
    for rows in ranges:
        sizes += rows.layers[layer].stream_bytes
    sizes[Stream.MODELS] += sum(len(block.payload) for block in blocks)
    return [int(size) for size in sizes]


def _pieces(work: Work, number: int, rows: Rows, layer: int) -> Iterator[bytes]:
    """The bytes of a range in a layer."""
    sizes = [int(one.lengths.sum()) for one in rows.layers]
    begin, end = sum(sizes[:layer]), sum(sizes[: layer + 1])
    if begin == end:
        return
    with opened(work.origin(numbered("segments", number))) as source:
        for offset in range(begin, end, PIECE_BYTES):
            yield source.read(offset, min(PIECE_BYTES, end - offset))
