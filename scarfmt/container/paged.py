"""A file that is opened: header, directory and blocks, of which only what is asked for is read (SPEC §5).

Everything returned has been checked: the header when the file is opened, each page of the directory when it is first
used, a block when it is read. Neighbouring pages or blocks are read in one request, a small directory all at once.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property, partial
from typing import Self

import numpy as np

from scarfmt.arrays import I64, U32, Bools
from scarfmt.container.directory import Entry, Table, Tile, block_name, entry_from_row
from scarfmt.container.header import read_header
from scarfmt.container.pages import unpack_each, unpack_row_pages, unpack_tile_pages
from scarfmt.container.root import Root, unpack_root
from scarfmt.container.schema import READABLE_KINDS, TILE_DTYPE, BlockKind
from scarfmt.container.source import COALESCE_BYTES, HEAD_BYTES, ByteSource
from scarfmt.errors import Malformed, Truncated
from scarfmt.limits import DEFAULT_LIMITS, Limits

AT_ONCE_BYTES = HEAD_BYTES
"""A directory up to this size is read whole: asking for its parts would take longer than they do."""


class Container:
    """A file opened for reading: its header is read and checked.

    Args:
        allow_truncated: accept a source that ends early; its whole blocks are readable.
        readable_kinds: block kinds the caller understands; other critical kinds refuse the file.

    Attributes:
        source: where the bytes come from.
        header: the checked header.
        limits: what this reader accepts.

    Raises:
        Malformed, Truncated, Unsupported, LimitExceeded: see :func:`read_header`.
    """

    def __init__(
        self,
        source: ByteSource,
        *,
        limits: Limits = DEFAULT_LIMITS,
        allow_truncated: bool = False,
        readable_kinds: Iterable[int] = READABLE_KINDS,
    ) -> None:
        self.header = read_header(source, limits=limits, allow_truncated=allow_truncated)
        self.source, self.limits, self._readable = source, limits, frozenset(readable_kinds)
        self._tiles: dict[int, Table] = {}
        # By number in ROOT: entries, and their tiles side by side in memory, to search in.
        self._rows: dict[int, tuple[Table, U32]] = {}
        self._kept_from, self._kept = 0, b""
        self._begun = False

    @cached_property
    def root(self) -> Root:
        """ROOT: blocks that belong to no tile, and where pages are.

        Raises:
            Malformed, Truncated, Unsupported, LimitExceeded: as SPEC §12 lists for §5.4.
        """
        header = self.header
        size = header.data_offset - header.header_length
        self._begin(size if size <= AT_ONCE_BYTES else header.root_length)
        return unpack_root(self._bytes(header.header_length, header.root_length), header, self.limits, self._readable)

    def _begin(self, length: int) -> None:
        """Read the first bytes after the header, unless that was done."""
        header = self.header
        if self._begun:
            return
        if self.source.size < header.data_offset:
            message = f"the file ends before its first block at byte {header.data_offset}"
            raise Truncated("truncated-directory", message, offset=self.source.size)
        self._kept_from, self._kept = header.header_length, self.source.read(header.header_length, length)
        self._begun = True

    def _bytes(self, offset: int, length: int) -> bytes:
        start = offset - self._kept_from
        if start + length <= len(self._kept):
            return self._kept[start : start + length]
        return self.source.read(offset, length)

    def load(self, layers: int | None = None, tiles: Sequence[int] | I64 | None = None) -> Self:
        """Read and check the pages of the directory that are needed, in few requests; returns self.

        Args:
            layers: of the first so many layers; None for all.
            tiles: of these tiles; None for all.

        Raises:
            Malformed, Truncated, Unsupported, LimitExceeded: as SPEC §12 lists for §5.4 and §5.5.
        """
        header = self.header
        if layers is None and tiles is None:
            self._begin(header.data_offset - header.header_length)
        pages = range(header.page_count) if tiles is None else self._pages_of(np.asarray(tiles, np.int64))
        chosen = self.root.rows["layer"] <= (layers or header.layer_count)
        if tiles is not None:
            chosen &= np.isin(self.root.rows["page"], pages)
        self._read(pages, np.flatnonzero(chosen).tolist())
        if len(self._kept) > AT_ONCE_BYTES:
            self._kept = b""
        return self

    def _read(self, pages: Iterable[int], rows: Iterable[int]) -> None:
        """Read the tile pages and row pages of these numbers in ROOT that are missing, and unpack them in that order.

        Neighbours are read in one request.
        """
        root = self.root
        pages = [page for page in pages if page not in self._tiles]
        rows = [number for number in rows if number not in self._rows]
        said, of_rows = root.pages[pages], root.rows[rows]
        spans = [
            *zip(said["offset"].tolist(), said["tile_bytes"].tolist(), strict=True),
            *zip(of_rows["offset"].tolist(), of_rows["row_bytes"].tolist(), strict=True),
        ]
        for run in runs(spans):
            start, past = spans[run.start][0], sum(spans[run.stop - 1])
            data = self._bytes(start, past - start)
            parts = [data[offset - start : offset - start + length] for offset, length in spans[run]]
            found = list(zip(pages[run], parts, strict=False))
            if found:
                tables = unpack_each(partial(unpack_tile_pages, pages=root.pages, header=self.header), found)
                self._tiles.update(zip(pages[run], tables, strict=True))
            first = max(run.start - len(pages), 0)
            found = list(zip(rows[first:], parts[len(found) :], strict=False))
            if found:
                read = partial(unpack_row_pages, pages=root.rows, header=self.header, limits=self.limits)
                tables = unpack_each(read, found)
                for (number, _), table in zip(found, tables, strict=True):
                    self._rows[number] = table, np.ascontiguousarray(table["tile"])

    def rows(self, layer: int) -> Table:
        """ENTRY_DTYPE of all blocks of a layer, in file order; reads its row pages."""
        numbers = np.flatnonzero(self.root.rows["layer"] == layer).tolist()
        self._read([], numbers)
        models = self.root.models[self.root.models["layer"] == layer]
        before = models["kind"] < BlockKind.TILE
        return np.concatenate([models[before], *(self._rows[number][0] for number in numbers), models[~before]])

    @cached_property
    def directory(self) -> Table:
        """(E,) ENTRY_DTYPE in file order; its rows are the same blocks as `entries`. Reads all pages."""
        self.load()
        return np.concatenate([self.rows(layer) for layer in range(1, self.header.layer_count + 1)])

    @cached_property
    def tile_table(self) -> Table:
        """(T,) TILE_DTYPE; reads all tile pages."""
        return self.tile_rows(np.arange(self.header.tile_count))

    @cached_property
    def tiles(self) -> tuple[Tile, ...]:
        """The tile table as objects."""
        return tuple(Tile(*row) for row in self.tile_table.tolist())

    @cached_property
    def entries(self) -> tuple[Entry, ...]:
        """The directory as objects, in file order."""
        return tuple(map(entry_from_row, self.directory.tolist()))

    def tile(self, number: int) -> Tile:
        """A tile; reads the page it is in."""
        page = number >> self.header.page_bits
        self._read([page], [])
        return Tile(*self._tiles[page][number - self.header.page_range(page).start].tolist())

    @cached_property
    def models(self) -> tuple[Entry, ...]:
        """The entries of the blocks that belong to no tile, by layer and kind; reads ROOT alone."""
        return tuple(map(entry_from_row, self.root.models.tolist()))

    def find(self, kind: int, layer: int, tile: int | None = None) -> Entry | None:
        """The entry of (kind, layer, tile), or None; `tile` None means a block of no tile. Reads the page it is in."""
        if tile is None:
            return next((entry for entry in self.models if (entry.layer, entry.kind) == (layer, kind)), None)
        if kind != BlockKind.TILE or not 0 <= tile < self.header.tile_count:
            return None
        number = self.root.row_page(layer, tile >> self.header.page_bits)
        if number is None:
            return None
        if number not in self._rows:
            self._read([], [number])
        rows, tiles = self._rows[number]
        row = int(np.searchsorted(tiles, np.uint32(tile)))
        return entry_from_row(rows[row].tolist()) if row < len(tiles) and tiles[row] == tile else None

    def _pages_of(self, tiles: I64) -> list[int]:
        """The pages that some tiles are of."""
        return [int(page) for page in np.unique(tiles >> self.header.page_bits)]

    def tile_rows(self, tiles: I64) -> Table:
        """(n,) TILE_DTYPE of n tiles; reads their pages."""
        pages = self._pages_of(tiles)
        self._read(pages, [])
        tables = [self._tiles[page] for page in pages]
        starts = np.cumsum([0, *map(len, tables)])
        index = np.searchsorted(np.array(pages, np.int64), tiles >> self.header.page_bits)
        within = tiles & ((1 << self.header.page_bits) - 1)
        rows: Table = np.concatenate([np.zeros(0, TILE_DTYPE), *tables])[starts[index] + within]
        return rows

    def have_blocks(self, layers: int, tiles: I64) -> Bools:
        """(n,) bool: of n tiles, those of which any of the first layers has a block; reads their pages.

        A directory of a MiB can list hundreds of thousands of others.
        """
        self.load(layers, tiles)
        out = np.zeros(self.header.tile_count, bool)
        for number, (_, found) in self._rows.items():
            if self.root.rows["layer"][number] <= layers:
                out[found] = True
        return out[tiles]

    def tile_counts(self, layers: int, tiles: I64) -> I64:
        """(n, layers) int64 anchors that first appear in each of the first layers of n tiles; reads their pages."""
        self.load(layers, tiles)
        here = np.isin(self.root.rows["page"], self._pages_of(tiles))
        out = np.zeros((len(tiles), layers), np.int64)
        for layer in range(1, layers + 1):
            counts = np.zeros(self.header.tile_count, np.int64)
            for number in np.flatnonzero(here & (self.root.rows["layer"] == layer)).tolist():
                rows, found = self._rows[number]
                counts[found] = rows["count"]
            out[:, layer - 1] = counts[tiles]
        return out

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

        Raises:
            Truncated, Malformed: as :meth:`read_block`.
        """
        listed = list(entries)
        for run in runs([(entry.offset, entry.length) for entry in listed]):
            first, last = listed[run.start], listed[run.stop - 1]
            if first is last or not self.is_available(last):
                yield from ((entry, self.read_block(entry, verify=verify)) for entry in listed[run])
                continue
            data = self.source.read(first.offset, last.end - first.offset)
            for entry in listed[run]:
                block = data[entry.offset - first.offset : entry.end - first.offset]
                if verify:
                    check_crc(entry, zlib.crc32(block))
                yield entry, block


def runs(spans: Sequence[tuple[int, int]]) -> Iterator[slice]:
    """Pages or blocks grouped into stretches without gaps of at most COALESCE_BYTES (or one of them).

    Yields:
        Which of them belong together.
    """
    first = 0
    for number, (offset, length) in enumerate(spans):
        if number > first and (offset != sum(spans[number - 1]) or offset + length - spans[first][0] > COALESCE_BYTES):
            yield slice(first, number)
            first = number
    if first < len(spans):
        yield slice(first, len(spans))


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
