"""The directory of a file that is opened: ROOT, and pages as they are asked for (SPEC §5.4, §5.5).

What is needed together is read together: neighbouring pages in one request, and a small directory all at once.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cached_property
from typing import NamedTuple

import numpy as np

from scarfmt.arrays import I64, U32, Bools
from scarfmt.container.directory import Entry, Tile, entry_from_row
from scarfmt.container.header import Header
from scarfmt.container.pages import unpack_row_pages, unpack_tile_pages
from scarfmt.container.root import Root, unpack_root
from scarfmt.container.schema import ENTRY_DTYPE, TILE_DTYPE, BlockKind
from scarfmt.container.source import COALESCE_BYTES, HEAD_BYTES, ByteSource
from scarfmt.container.table_rules import Table
from scarfmt.errors import Truncated
from scarfmt.limits import Limits

AT_ONCE_BYTES = HEAD_BYTES
"""A directory up to this size is read whole: asking for its parts would take longer than they do."""


class _Part(NamedTuple):
    """A page to read: where it lies, whether it is a row page, and its number among those of its kind in ROOT."""

    offset: int
    length: int
    of_rows: bool
    number: int


class PagedDirectory:
    """The tiles and blocks of a file. Everything it returns was checked when it was read.

    Args:
        source: the file.
        header: of it.
        limits: what this reader accepts.
        readable: block kinds the caller understands; other critical kinds refuse the file.
    """

    def __init__(self, source: ByteSource, header: Header, limits: Limits, readable: frozenset[int]) -> None:
        self._source, self._header, self._limits, self._readable = source, header, limits, readable
        self._tiles: dict[int, Table] = {}
        # By layer and page: entries, and their tiles side by side in memory, to search in.
        self._rows: dict[tuple[int, int], tuple[Table, U32]] = {}
        self._kept_from, self._kept = 0, b""
        self._begun = False

    @cached_property
    def root(self) -> Root:
        """ROOT.

        Raises:
            Malformed, Truncated, Unsupported, LimitExceeded: as SPEC §12 lists for §5.4.
        """
        header = self._header
        size = header.data_offset - header.header_length
        self._begin(size if size <= AT_ONCE_BYTES else header.root_length)
        return unpack_root(self._bytes(header.header_length, header.root_length), header, self._limits, self._readable)

    def _begin(self, length: int) -> None:
        """Read the first bytes after the header, unless that was done."""
        header = self._header
        if self._begun:
            return
        if self._source.size < header.data_offset:
            message = f"the file ends before its first block at byte {header.data_offset}"
            raise Truncated("truncated-directory", message, offset=self._source.size)
        self._kept_from, self._kept = header.header_length, self._source.read(header.header_length, length)
        self._begun = True

    def _bytes(self, offset: int, length: int) -> bytes:
        start = offset - self._kept_from
        if start + length <= len(self._kept):
            return self._kept[start : start + length]
        return self._source.read(offset, length)

    def load(self, layers: int | None = None, pages: Iterable[int] | None = None) -> None:
        """Read what is missing of tile pages and of the row pages of the first layers.

        Args:
            layers: how many; None for all.
            pages: of which pages; None for all.

        Raises:
            Malformed, Truncated, Unsupported, LimitExceeded: as SPEC §12 lists for §5.4 and §5.5.
        """
        header = self._header
        if layers is None and pages is None:
            self._begin(header.data_offset - header.header_length)
        wanted = range(header.page_count) if pages is None else sorted(set(pages))
        rows = self.root.rows
        chosen = np.flatnonzero((rows["layer"] <= (layers or header.layer_count)) & _among(rows["page"], pages))
        self._read([*self._tile_parts(wanted), *self._row_parts(chosen)])
        if len(self._kept) > AT_ONCE_BYTES:
            self._kept = b""

    def _tile_parts(self, pages: Iterable[int]) -> Iterator[_Part]:
        """The tile pages among `pages` that are missing."""
        missing = [page for page in pages if page not in self._tiles]
        said = self.root.pages[missing]
        for page, offset, length in zip(missing, said["offset"].tolist(), said["tile_bytes"].tolist(), strict=True):
            yield _Part(offset, length, False, page)

    def _row_parts(self, numbers: I64) -> Iterator[_Part]:
        """The row pages of some numbers in ROOT that are missing."""
        columns = (self.root.rows[name][numbers].tolist() for name in ("layer", "page", "offset", "row_bytes"))
        for number, layer, page, offset, length in zip(numbers.tolist(), *columns, strict=True):
            if (layer, page) not in self._rows:
                yield _Part(offset, length, True, number)

    def _read(self, parts: Iterable[_Part]) -> None:
        """Read pages, neighbours in one request, and unpack them in that order."""
        for run in _runs(parts):
            start = run[0].offset
            data = self._bytes(start, run[-1].offset + run[-1].length - start)
            pages = [(part, data[part.offset - start : part.offset - start + part.length]) for part in run]
            self._take_tiles([(part.number, page) for part, page in pages if not part.of_rows])
            self._take_rows([(self.root.rows[part.number], page) for part, page in pages if part.of_rows])

    def _take_tiles(self, found: list[tuple[int, bytes]]) -> None:
        if found:
            tables = unpack_tile_pages(found, self.root.pages, self._header)
            self._tiles.update(zip((page for page, _ in found), tables, strict=True))

    def _take_rows(self, found: list[tuple[np.void, bytes]]) -> None:
        if found:
            tables = unpack_row_pages(found, self._header, self._limits)
            for (said, _), rows in zip(found, tables, strict=True):
                self._rows[int(said["layer"]), int(said["page"])] = rows, np.ascontiguousarray(rows["tile"])

    def page_tiles(self, page: int) -> Table:
        """(n,) TILE_DTYPE of a page."""
        if page not in self._tiles:
            self._read(self._tile_parts([page]))
        return self._tiles[page]

    def page_rows(self, layer: int, page: int) -> Table:
        """ENTRY_DTYPE of the TILE blocks of a page in a layer, by tile."""
        return self._page_rows(layer, page)[0]

    def _page_rows(self, layer: int, page: int) -> tuple[Table, U32]:
        if (layer, page) not in self._rows:
            number = self.root.row_page(layer, page)
            if number is None:
                return np.zeros(0, ENTRY_DTYPE), np.zeros(0, np.uint32)
            self._read(self._row_parts(np.array([number])))
        return self._rows[layer, page]

    def rows(self, layer: int) -> Table:
        """ENTRY_DTYPE of all blocks of a layer, in file order."""
        numbers = np.flatnonzero(self.root.rows["layer"] == layer)
        self._read(self._row_parts(numbers))
        models = self.root.models[self.root.models["layer"] == layer]
        before = models["kind"] < BlockKind.TILE
        tiles = [self.page_rows(layer, page) for page in self.root.rows["page"][numbers].tolist()]
        return np.concatenate([models[before], *tiles, models[~before]])

    @cached_property
    def directory(self) -> Table:
        """(E,) ENTRY_DTYPE of all blocks, in file order."""
        self.load()
        return np.concatenate([self.rows(layer) for layer in range(1, self._header.layer_count + 1)])

    @cached_property
    def tile_table(self) -> Table:
        """(T,) TILE_DTYPE."""
        pages = range(self._header.page_count)
        self._read(self._tile_parts(pages))
        return np.concatenate([np.zeros(0, TILE_DTYPE), *(self._tiles[page] for page in pages)])

    def tile(self, number: int) -> Tile:
        """A tile."""
        page = number >> self._header.page_bits
        return Tile(*self.page_tiles(page)[number - self._header.page_range(page).start].tolist())

    @cached_property
    def models(self) -> dict[tuple[int, int], Entry]:
        """The blocks that belong to no tile, by (layer, kind)."""
        entries = map(entry_from_row, self.root.models.tolist())
        return {(entry.layer, entry.kind): entry for entry in entries}

    def find(self, kind: int, layer: int, tile: int | None) -> Entry | None:
        """The entry of (kind, layer, tile), or None; `tile` None means a block of no tile."""
        if tile is None:
            return self.models.get((layer, kind))
        if kind != BlockKind.TILE or not 0 <= tile < self._header.tile_count:
            return None
        rows, tiles = self._page_rows(layer, tile >> self._header.page_bits)
        row = int(np.searchsorted(tiles, np.uint32(tile)))
        return entry_from_row(rows[row].tolist()) if row < len(tiles) and tiles[row] == tile else None

    def pages_of(self, tiles: I64) -> list[int]:
        """The pages that some tiles are of."""
        return [int(page) for page in np.unique(tiles >> self._header.page_bits)]

    def tile_rows(self, tiles: I64) -> Table:
        """(n,) TILE_DTYPE of n tiles."""
        pages = np.array(self.pages_of(tiles), np.int64)
        self._read(self._tile_parts(pages.tolist()))
        tables = [self._tiles[page] for page in pages.tolist()]
        starts = np.cumsum([0, *map(len, tables)])
        index = np.searchsorted(pages, tiles >> self._header.page_bits)
        within = tiles - (pages[index] << self._header.page_bits)
        rows: Table = np.concatenate([np.zeros(0, TILE_DTYPE), *tables])[starts[index] + within]
        return rows

    def have_blocks(self, layers: int, tiles: I64) -> Bools:
        """(n,) bool: of n tiles, those of which any of the first layers has a block."""
        self.load(layers, self.pages_of(tiles))
        out = np.zeros(self._header.tile_count, bool)
        for (layer, _), (_, found) in self._rows.items():
            if layer <= layers:
                out[found] = True
        return out[tiles]

    def tile_counts(self, layers: int, tiles: I64) -> I64:
        """(n, layers) int64 anchors that first appear in each of the first layers of n tiles."""
        pages = self.pages_of(tiles)
        self.load(layers, pages)
        out = np.zeros((len(tiles), layers), np.int64)
        for layer in range(1, layers + 1):
            known = [self._rows[layer, page][0] for page in pages if (layer, page) in self._rows]
            rows = np.concatenate([np.zeros(0, ENTRY_DTYPE), *known])
            counts = np.zeros(self._header.tile_count, np.int64)
            counts[rows["tile"]] = rows["count"]
            out[:, layer - 1] = counts[tiles]
        return out


def _among(pages: U32, wanted: Iterable[int] | None) -> Bools | bool:
    return True if wanted is None else np.isin(pages, sorted(set(wanted)))


def _runs(parts: Iterable[_Part]) -> Iterator[list[_Part]]:
    """Pages grouped into stretches without gaps of at most COALESCE_BYTES (or one page)."""
    run: list[_Part] = []
    for part in parts:
        past = run[-1].offset + run[-1].length if run else part.offset
        if run and (part.offset != past or past + part.length - run[0].offset > COALESCE_BYTES):
            yield run
            run = []
        run.append(part)
    if run:
        yield run
