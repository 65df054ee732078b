"""The container: header, directory and blocks, written and read (SPEC §5).

The layout is in :mod:`scarfmt.container.schema`. Blocks are opaque bytes here. Everything a reader returns has been
checked: the header when the file is opened, each page of the directory when it is first used, a block when it is read.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from construct import ConstructError

from scarfmt.arrays import I64, Bools
from scarfmt.container.directory import (
    Entry,
    Table,
    Tile,
    block_name,
    entry_from_row,
    required_flags,
    sort_keys,
    tile_table,
)
from scarfmt.container.header import Header, HeaderFields, LayerSummary, encode_header, make_header, read_header
from scarfmt.container.paged import PagedDirectory
from scarfmt.container.pages import pack_row_pages, pack_tile_pages
from scarfmt.container.root import Root, pack_root
from scarfmt.container.schema import (
    ENTRY_DTYPE,
    NO_TILE,
    READABLE_KINDS,
    STREAM_COUNT,
    BlockKind,
    Stream,
    header_length,
)
from scarfmt.container.source import COALESCE_BYTES as COALESCE_BYTES
from scarfmt.container.source import ByteSource, BytesSource
from scarfmt.errors import InvalidInput, Malformed, ScarError, Truncated
from scarfmt.limits import DEFAULT_LIMITS, FORMAT_LIMITS, MAX_PAGE_BITS, Limits

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
        fields: the scene's header fields.
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
        fields: the scene's header fields.
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
        pages = pack_tile_pages(tiles, fields.lattice_bits, page_bits)
    except ScarError as error:
        raise InvalidInput("input-container", f"the file would break a rule: {error}") from error
    by_layer = [
        pack_row_pages(directory[in_tiles & (directory["layer"] == layer)], len(tiles), page_bits)
        for layer in range(1, layers + 1)
    ]
    root = pack_root(layers, directory[~in_tiles], pages, list(zip(*by_layer, strict=True)))
    parts = [page.data for page in pages] + [row.data for rows in by_layer for row in rows if row is not None]
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
        Container.open(BytesSource(front), limits=FORMAT_LIMITS, allow_truncated=True, readable_kinds=range(256)).load()
    except ScarError as error:
        raise InvalidInput("input-container", f"the file would break a rule: {error}") from error


class Container:
    """A file opened for reading. Of the directory the pages are read that are needed, when first used.

    Attributes:
        source: where the bytes come from.
        header: the checked header.
        limits: what this reader accepts.
    """

    def __init__(self, source: ByteSource, header: Header, limits: Limits, readable_kinds: frozenset[int]) -> None:
        self.source = source
        self.header = header
        self.limits = limits
        self._paged = PagedDirectory(source, header, limits, readable_kinds)

    @classmethod
    def open(
        cls,
        source: ByteSource,
        *,
        limits: Limits = DEFAULT_LIMITS,
        allow_truncated: bool = False,
        readable_kinds: Iterable[int] = READABLE_KINDS,
    ) -> Container:
        """Read and check the header.

        Args:
            source: the file.
            limits: what this reader accepts.
            allow_truncated: accept a source that ends early; its whole blocks are readable.
            readable_kinds: block kinds the caller understands; other critical kinds refuse the file.

        Raises:
            Malformed, Truncated, Unsupported, LimitExceeded: see :func:`read_header`.
        """
        header = read_header(source, limits=limits, allow_truncated=allow_truncated)
        return cls(source, header, limits, frozenset(readable_kinds))

    @property
    def root(self) -> Root:
        """ROOT: blocks that belong to no tile, and where pages are.

        Raises:
            Malformed, Truncated, Unsupported, LimitExceeded: as SPEC §12 lists for §5.4.
        """
        return self._paged.root

    def load(self, layers: int | None = None, tiles: Sequence[int] | None = None) -> Container:
        """Read and check the pages of the directory that are needed, in few requests; returns self.

        Args:
            layers: of the first so many layers; None for all.
            tiles: of these tiles; None for all.

        Raises:
            Malformed, Truncated, Unsupported, LimitExceeded: as SPEC §12 lists for §5.4 and §5.5.
        """
        pages = None if tiles is None else self._paged.pages_of(np.asarray(tiles, np.int64))
        self._paged.load(layers, pages)
        return self

    def page_tiles(self, page: int) -> Table:
        """(n,) TILE_DTYPE of a page; reads no other."""
        return self._paged.page_tiles(page)

    def page_rows(self, layer: int, page: int) -> Table:
        """ENTRY_DTYPE of the TILE blocks of a page in a layer, by tile; reads no other page."""
        return self._paged.page_rows(layer, page)

    def rows(self, layer: int) -> Table:
        """ENTRY_DTYPE of all blocks of a layer, in file order; reads its row pages."""
        return self._paged.rows(layer)

    @property
    def tile_table(self) -> Table:
        """(T,) TILE_DTYPE; reads all tile pages."""
        return self._paged.tile_table

    @property
    def directory(self) -> Table:
        """(E,) ENTRY_DTYPE in file order; its rows are the same blocks as `entries`. Reads all pages."""
        return self._paged.directory

    @cached_property
    def tiles(self) -> tuple[Tile, ...]:
        """The tile table as objects."""
        return tuple(Tile(*row) for row in self.tile_table.tolist())

    @cached_property
    def entries(self) -> tuple[Entry, ...]:
        """The directory as objects, in file order."""
        return tuple(map(entry_from_row, self.directory.tolist()))

    @property
    def models(self) -> tuple[Entry, ...]:
        """The entries of the blocks that belong to no tile, by layer and kind; reads ROOT alone."""
        return tuple(self._paged.models.values())

    def find(self, kind: int, layer: int, tile: int | None = None) -> Entry | None:
        """The entry of (kind, layer, tile), or None; `tile` None means a block of no tile. Reads the page it is in."""
        return self._paged.find(kind, layer, tile)

    def tile(self, number: int) -> Tile:
        """A tile; reads the page it is in."""
        return self._paged.tile(number)

    def tile_rows(self, tiles: I64) -> Table:
        """(n,) TILE_DTYPE of n tiles; reads their pages."""
        return self._paged.tile_rows(tiles)

    def have_blocks(self, layers: int, tiles: I64) -> Bools:
        """(n,) bool: of n tiles, those of which any of the first layers has a block; reads their pages.

        A directory of a MiB can list hundreds of thousands of others.
        """
        return self._paged.have_blocks(layers, tiles)

    def tile_counts(self, layers: int, tiles: I64) -> I64:
        """(n, layers) int64 anchors that first appear in each of the first layers of n tiles; reads their pages."""
        return self._paged.tile_counts(layers, tiles)

    def tile_entries(self, tile: int, layers: int) -> list[Entry | None]:
        """The TILE block of a tile in each of the first `layers` layers, None where it has none."""
        return [self.find(BlockKind.TILE, layer, tile) for layer in range(1, layers + 1)]

    @property
    def available_layers(self) -> int:
        """Number of layers, from the first, whose blocks are all in the source."""
        return sum(layer.end_offset <= self.source.size for layer in self.header.layers)

    def is_available(self, entry: Entry) -> bool:
        """Whether the whole block is in the source; always so unless the source is truncated."""
        return entry.end <= self.source.size

    def read_block(self, entry: Entry, *, verify: bool = True) -> bytes:
        """The bytes of a block.

        Args:
            entry: an entry of this container.
            verify: check the block's CRC-32.

        Raises:
            Truncated: ``truncated-block`` when the source ends before the block does.
            Malformed: ``crc-mismatch`` when the block is damaged.
        """
        data = self.read_range(entry, 0, entry.length)
        if verify:
            check_crc(entry, zlib.crc32(data))
        return data

    def read_range(self, entry: Entry, start: int, length: int) -> bytes:
        """`length` bytes of a block from `start` within it, unverified: a CRC-32 covers whole blocks only.

        Raises:
            Truncated: ``truncated-block`` when the source ends before the range does.
            Malformed: ``block-range`` when the range leaves the block.
        """
        if start < 0 or length < 0 or start + length > entry.length:
            message = f"{length} bytes at {start} leave a block of {entry.length} bytes"
            raise Malformed("block-range", message, offset=entry.offset, field=block_name(entry))
        if entry.offset + start + length > self.source.size:
            message = f"the file ends at byte {self.source.size}, before the end of the block at {entry.end}"
            raise Truncated("truncated-block", message, offset=entry.offset, field=block_name(entry))
        return self.source.read(entry.offset + start, length)

    def read_blocks(self, entries: Iterable[Entry], *, verify: bool = True) -> Iterator[tuple[Entry, bytes]]:
        """Blocks in the given order; blocks that follow each other in the file share one request.

        Args:
            entries: entries of this container.
            verify: check the CRC-32 of each.

        Raises:
            Truncated, Malformed: as :meth:`read_block`.
        """
        for run in _runs(entries):
            if len(run) == 1 or not self.is_available(run[-1]):
                yield from ((entry, self.read_block(entry, verify=verify)) for entry in run)
                continue
            data = self.source.read(run[0].offset, run[-1].end - run[0].offset)
            for entry in run:
                block = data[entry.offset - run[0].offset : entry.end - run[0].offset]
                if verify:
                    check_crc(entry, zlib.crc32(block))
                yield entry, block


def _runs(entries: Iterable[Entry]) -> Iterator[list[Entry]]:
    """Entries grouped into stretches without gaps of at most COALESCE_BYTES (or one entry)."""
    run: list[Entry] = []
    for entry in entries:
        if run and (entry.offset != run[-1].end or entry.end - run[0].offset > COALESCE_BYTES):
            yield run
            run = []
        run.append(entry)
    if run:
        yield run


def check_crc(entry: Entry, crc32: int) -> None:
    """Compare the CRC-32 computed over a block with its entry's.

    Raises:
        Malformed: ``crc-mismatch``.
    """
    if crc32 != entry.crc32:
        raise Malformed(
            "crc-mismatch",
            f"the block's CRC-32 is {crc32:08x}, the directory says {entry.crc32:08x}: get another copy",
            offset=entry.offset,
            field=block_name(entry),
        )
