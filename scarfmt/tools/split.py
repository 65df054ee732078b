"""A file as several, each with some of its tiles and all of its models, without decoding it.

`merge` makes the file again of them, with directory pages of the usual size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import BinaryIO

import numpy as np

from scarfmt.arrays import I64
from scarfmt.blocks.streaming import Streaming, read_streaming, streaming_block
from scarfmt.coding.reader import SceneReader
from scarfmt.container.directory import Table
from scarfmt.container.file import Container, directory_row
from scarfmt.container.schema import ENTRY_DTYPE, STREAM_COUNT, BlockKind, Profile, Stream
from scarfmt.container.source import ByteSource
from scarfmt.container.substreams import MAX_TABLE_SIZE, unpack_table
from scarfmt.errors import InvalidInput, plural
from scarfmt.tools.assemble import Plan, entry_of, order_rows
from scarfmt.tools.merge import model_bytes


def even_parts(container: Container, parts: int) -> list[I64]:
    """Tiles of each of some parts that follow each other in space, with about as many bytes each.

    Args:
        parts: how many, at most as many as it has tiles.

    Raises:
        InvalidInput: ``input-parts``: it has fewer tiles.
    """
    count = len(container.tile_table)
    if not 1 <= parts <= count:
        raise InvalidInput("input-parts", f"the file has {plural(count, 'tile')}: it cannot be cut into {parts} files")
    rows = container.directory[container.directory["kind"] == BlockKind.TILE]
    size = np.bincount(rows["tile"], rows["length"].astype(np.float64), count).cumsum()
    ends: list[int] = []
    for part in range(1, parts):
        end = int(np.searchsorted(size, part * size[-1] / parts)) + 1
        # Each part has a tile at least, whatever the bytes of the others.
        ends.append(min(max(end, (ends or [0])[-1] + 1), count - parts + part))
    return list(np.split(np.arange(count), ends))


def split_to(source: ByteSource, parts: Sequence[I64], targets: Sequence[BinaryIO]) -> list[int]:
    """Write a file for each of some sets of tiles, in pieces of at most 1 MiB.

    Blocks are verified while they are copied, so targets hold unfinished files when an error is raised. The Gaussians
    of the encoder's input are divided among the files as those that were kept are.

    Args:
        parts: (n,) tiles of each, ascending; no tile is in two, and each has one at least.
        targets: as many, opened for writing in binary mode.

    Returns:
        Bytes written to each.

    Raises:
        Malformed, Truncated, Unsupported, LimitExceeded: what a decoder of these tiles refuses.
    """
    reader = SceneReader(source)
    container = reader.container
    kept = container.directory[container.directory["kind"] == BlockKind.TILE]
    anchors = np.bincount(kept["tile"], kept["count"].astype(np.float64), len(container.tile_table))
    sources = _shares(container.header.fields.source_count, [float(anchors[tiles].sum()) for tiles in parts])
    written = []
    for tiles, share, target in zip(parts, sources, targets, strict=True):
        written.append(_part(reader, tiles, share).write([container], target))
    return written


def _shares(total: int, weights: Sequence[float]) -> list[int]:
    """A number divided in proportion; shares add up to it where the weights are those of everything."""
    whole = sum(weights) or 1.0
    ends = [int(total * share) for share in np.cumsum(weights) / whole]
    ends[-1] = total
    return np.diff(ends, prepend=0).tolist()


def _part(reader: SceneReader, tiles: I64, source_count: int) -> Plan:
    """The file of some tiles."""
    container = reader.container
    rows = container.directory
    outside = rows[(rows["kind"] != BlockKind.TILE) & (rows["kind"] != BlockKind.STREAMING)]
    own = rows[(rows["kind"] == BlockKind.TILE) & np.isin(rows["tile"], tiles)].copy()
    streams = _stream_bytes(container, own)
    own["tile"] = np.searchsorted(tiles, own["tile"])
    table, origin, made = np.concatenate([outside, own]), np.zeros(len(outside) + len(own), np.int64), []
    whole = read_streaming(container)
    if whole is not None:
        block = streaming_block(Streaming(whole.low[tiles], whole.high[tiles], whole.reach[tiles], whole.view))
        table = np.concatenate([table, np.array([directory_row(block)], ENTRY_DTYPE)])
        origin, made = np.append(origin, -1), [block.payload]
    for layer, models in enumerate(model_bytes(table, container.header.layer_count)):
        streams[layer][Stream.MODELS] = models
    fields = replace(container.header.fields, source_count=source_count)
    counts = _counts(reader, tiles, own)
    return Plan(fields, container.tile_table[tiles], *order_rows(table, origin), made, counts, streams)


def _stream_bytes(container: Container, rows: Table) -> list[list[int]]:
    """Per layer, bytes of each kind of stream in some TILE blocks, as their own tables say."""
    sizes = np.zeros((container.header.layer_count, STREAM_COUNT), np.int64)
    for row in rows:
        entry = entry_of(row)
        table = unpack_table(container.read_range(entry, 0, min(entry.length, MAX_TABLE_SIZE)), entry.length)
        for stream, part in table.items():
            sizes[entry.layer - 1, stream] += part.length
        sizes[entry.layer - 1, Stream.FRAMING] += entry.length - sum(part.length for part in table.values())
    return [list(map(int, layer)) for layer in sizes]


def _counts(reader: SceneReader, tiles: I64, rows: Table) -> list[tuple[int, int]]:
    """Per layer, cumulative (anchors, Gaussians) of some tiles. The Gaussians of an anchor model are known only by
    decoding."""
    layers = reader.header.layer_count
    new = np.bincount(rows["layer"], rows["count"].astype(np.float64), layers + 1)[1:]
    anchors = [int(count) for count in new.cumsum()]
    if reader.header.fields.profile == Profile.EXPLICIT:
        return [(count, count) for count in anchors]
    shown = np.zeros(layers + 1, np.int64)
    for _, content in reader.tiles(reader.models(), tiles.tolist(), frozenset()):
        shown += np.bincount(content.slot_layers[content.slot_layers > 0], minlength=layers + 1)
    return [(count, int(slots)) for count, slots in zip(anchors, shown[1:].cumsum(), strict=True)]
