"""The container: header, directory and blocks, written and read (SPEC §5).

The layout is in :mod:`scarfmt.container.schema`. Blocks are opaque bytes here. Everything a reader returns has been
checked: the header when the file is opened, each page of the directory when it is first used, a block when it is read.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from construct import ConstructError

from scarfmt.container.directory import Entry, Table, Tile, required_flags, sort_keys, tile_table
from scarfmt.container.header import (
    Header,
    HeaderFields,
    LayerSummary,
    encode_header,
    header_length,
    make_header,
    read_header,
)
from scarfmt.container.paged import Container, check_crc
from scarfmt.container.pages import pack_row_pages, pack_tile_pages
from scarfmt.container.root import Root, pack_root
from scarfmt.container.schema import ENTRY_DTYPE, NO_TILE, STREAM_COUNT, BlockKind, Stream
from scarfmt.container.source import COALESCE_BYTES as COALESCE_BYTES
from scarfmt.container.source import BytesSource
from scarfmt.errors import InvalidInput, ScarError
from scarfmt.limits import FORMAT_LIMITS, MAX_PAGE_BITS

__all__ = [
    "Block",
    "Container",
    "Entry",
    "Header",
    "HeaderFields",
    "LayerSummary",
    "Tile",
    "check_crc",
    "encode_front",
    "read_header",
    "tile_table",
    "write_container",
]

PAGE_BITS = 10
"""The default of a writer: row pages of about 7 KB, of which a region needs one or two a layer (R-5.4-18)."""


@dataclass(frozen=True)
class Block:
    """A block to write.

    Attributes:
        kind: block kind, 1..255.
        layer: layer it belongs to, 1-based.
        payload: its bytes, at least one.
        tile: number of the tile, for TILE, or None.
        count: elements; for TILE, the anchors that first appear in it.
        stream_bytes: for TILE, bytes per stream kind; what they leave of the payload is FRAMING.
        flags: critical or safe-to-copy; None takes what SPEC §5 prescribes for the kind (0 if nothing).
    """

    kind: int
    layer: int
    payload: bytes
    tile: int | None = None
    count: int = 0
    stream_bytes: dict[int, int] = field(default_factory=dict)
    flags: int | None = None


def _block_key(block: Block) -> tuple[int, int, int]:
    return block.layer, block.kind, NO_TILE if block.tile is None else block.tile


def directory_row(block: Block) -> tuple[int, ...]:
    """The fields of a block's entry; its offset is filled in by :func:`encode_front`."""
    flags = block.flags if block.flags is not None else int(required_flags(block.kind) or 0)
    layer, kind, tile = _block_key(block)
    return kind, flags, layer, tile, 0, len(block.payload), block.count, zlib.crc32(block.payload)


def streams_of(block: Block) -> list[int]:
    """Bytes of a block by kind of stream.

    Raises:
        InvalidInput: ``input-container``.
    """
    streams = [0] * STREAM_COUNT
    if block.kind != BlockKind.TILE:
        streams[Stream.MODELS] = len(block.payload)
        return streams
    for kind, size in block.stream_bytes.items():
        streams[Stream(kind)] += size
    rest = len(block.payload) - sum(streams)
    if rest < 0 or min(streams) < 0 or streams[Stream.MODELS]:
        raise InvalidInput(
            "input-container",
            f"stream_bytes {block.stream_bytes} do not fit a TILE block of {len(block.payload)} bytes",
            field="stream_bytes",
        )
    streams[Stream.FRAMING] += rest
    return streams


def write_container(
    fields: HeaderFields,
    tiles: Sequence[Tile],
    blocks: Iterable[Block],
    layer_counts: Sequence[tuple[int, int]],
    page_bits: int = PAGE_BITS,
) -> bytes:
    """A whole file. Blocks may come in any order; equal arguments give equal bytes.

    Args:
        tiles: tile table, ascending by Morton range, disjoint.
        blocks: at most one per (layer, kind, tile).
        layer_counts: per layer, cumulative (anchors, gaussians).
        page_bits: tiles of a page, as a power of two, 0..16.

    Raises:
        InvalidInput: ``input-container``, quoting the rule of SPEC §5 that the file would break.
    """
    ordered = sorted(blocks, key=_block_key)
    streams = np.zeros((len(layer_counts) + 1, STREAM_COUNT), np.int64)
    try:
        for block in ordered:
            if not 1 <= block.layer <= len(layer_counts):
                raise InvalidInput("input-container", f"block of layer {block.layer} of {len(layer_counts)}")
            streams[block.layer] += streams_of(block)
        directory = np.array([directory_row(block) for block in ordered], dtype=ENTRY_DTYPE)
        front = encode_front(fields, tile_table(tiles), directory, layer_counts, streams[1:].tolist(), page_bits)
    except (ConstructError, OverflowError, ValueError, struct.error) as error:
        if isinstance(error, InvalidInput):
            raise
        raise InvalidInput("input-container", f"a value does not fit its field: {error}") from error
    return b"".join([front, *(block.payload for block in ordered)])


def encode_front(
    fields: HeaderFields,
    tiles: Table,
    directory: Table,
    layer_counts: Sequence[tuple[int, int]],
    stream_bytes: Sequence[Sequence[int]],
    page_bits: int = PAGE_BITS,
) -> bytes:
    """Everything before the first block; offsets, sums and checksums are worked out here.

    Args:
        tiles: (T,) TILE_DTYPE.
        directory: (E,) ENTRY_DTYPE in file order; `offset` is ignored.
        layer_counts: per layer, cumulative (anchors, gaussians).
        stream_bytes: per layer, bytes per stream kind.
        page_bits: tiles of a page, as a power of two, 0..16.

    Raises:
        InvalidInput: ``input-container``, quoting the rule of SPEC §5 that the file would break.
    """
    layers = len(layer_counts)
    _check_sayable(directory, layers, len(tiles), page_bits)
    in_tiles = directory["kind"] == BlockKind.TILE
    try:
        pages, parts = pack_tile_pages(tiles, fields.lattice_bits, page_bits)
    except ScarError as error:
        raise InvalidInput("input-container", f"the file would break a rule: {error}") from error
    by_layer = [
        pack_row_pages(directory[in_tiles & (directory["layer"] == layer)], layer, len(tiles), page_bits)
        for layer in range(1, layers + 1)
    ]
    root = pack_root(Root(directory[~in_tiles], pages, np.concatenate([rows for rows, _ in by_layer])), layers)
    parts += [part for _, packed in by_layer for part in packed]
    summaries, end = [], header_length(layers) + len(root) + sum(map(len, parts))
    for counts, streams in zip(layer_counts, stream_bytes, strict=True):
        size = sum(streams)
        end += size
        summaries.append(LayerSummary(*counts, size, end, tuple(streams)))
    front = b"".join([encode_header(make_header(fields, summaries, page_bits, len(tiles), root)), root, *parts])
    _check_written(front)
    return front


def _check_sayable(directory: Table, layers: int, tiles: int, page_bits: int) -> None:
    """Refuse what pages and ROOT cannot say; what they can say wrong, a reader finds."""
    in_tiles, layer = directory["kind"] == BlockKind.TILE, directory["layer"]
    keys = sort_keys(directory)
    for ok, message in (
        (layers > 0, "a file has a layer"),
        (page_bits <= MAX_PAGE_BITS, f"a page is of 2^0 to 2^{MAX_PAGE_BITS} tiles"),
        (bool(((layer >= 1) & (layer <= layers)).all()), f"blocks are of layers 1..{layers}"),
        (bool(((directory["tile"] == NO_TILE) != in_tiles).all()), "TILE blocks, and no others, belong to a tile"),
        (bool((directory["tile"][in_tiles] < tiles).all()), f"there are {tiles} tiles"),
        (bool((directory["length"] >= 1).all()), "a block has a byte or more"),
        (bool((keys[1:] > keys[:-1]).all()), "entries ascend by (layer, kind, tile)"),
    ):
        if not ok:
            raise InvalidInput("input-container", message)


def _check_written(front: bytes) -> None:
    # The reader's own rules are the writer's contract. Unknown critical kinds are a reader's matter.
    try:
        Container(BytesSource(front), limits=FORMAT_LIMITS, allow_truncated=True, readable_kinds=range(256)).load()
    except ScarError as error:
        raise InvalidInput("input-container", f"the file would break a rule: {error}") from error
