"""ROOT, tile pages and row pages (SPEC §5.4, §5.5): which tiles there are, and where every block lies."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import NamedTuple

from conformance.decoders.python.fields import Payload, require

NO_TILE = 0xFFFFFFFF
TILE = 16
DEEPEST = 21


class Tile(NamedTuple):
    """A cube of the lattice."""

    depth: int
    shift: int
    prefix: int


@dataclass(frozen=True)
class Entry:
    """The place of a block; `tile` is NO_TILE for a block that belongs to no tile."""

    kind: int
    flags: int
    layer: int
    tile: int
    offset: int
    length: int
    count: int
    crc32: int


class Span(NamedTuple):
    """A page: where its bytes are in the file, and their CRC-32."""

    start: int
    past: int
    crc32: int


class _Rows(NamedTuple):
    """The fields of a row page in ROOT."""

    size: int
    crc32: int
    block_bytes: int
    anchors: int


class _Page(NamedTuple):
    """The fields of a page in ROOT: the Morton code at which it begins, its tiles, its rows in every layer."""

    base: int
    size: int
    crc32: int
    rows: list[_Rows]


class Root:
    """The content of ROOT, and the place of every page.

    Args:
        data: a file whose header is sound.
    """

    def __init__(self, data: bytes) -> None:
        head = Payload(data)
        head.at = 12
        length, _ = head.fields("IQ")
        _, _, self.layer_count, _, _, _, _, self.page_bits, self.tile_count, size = head.fields("8BII")
        head.at = 96
        (crc,) = head.fields("I")
        root = data[length : length + size]
        require(zlib.crc32(root) == crc, "directory-crc-mismatch")
        reader = Payload(root)
        self.models = [_models(reader) for _ in range(self.layer_count)]
        self.pages: list[_Page] = []
        for _ in range(-(-self.tile_count >> self.page_bits)):
            base = self.pages[-1].base if self.pages else 0
            base += reader.varint(63)
            tile_bytes, tile_crc = reader.varint(32), reader.fields("I")[0]
            self.pages.append(_Page(base, tile_bytes, tile_crc, [_rows(reader) for _ in range(self.layer_count)]))
        reader.finish()
        self._place(length + size)

    def _place(self, at: int) -> None:
        """The places of pages: `tile_pages` by page; `row_pages` by layer, from 1, and page; `blocks`, the end of all
        pages."""
        self.tile_pages: list[Span] = []
        for page in self.pages:
            self.tile_pages.append(Span(at, at + page.size, page.crc32))
            at += page.size
        self.row_pages: dict[tuple[int, int], Span] = {}
        for layer in range(1, self.layer_count + 1):
            for number, page in enumerate(self.pages):
                rows = page.rows[layer - 1]
                if rows.size:
                    self.row_pages[layer, number] = Span(at, at + rows.size, rows.crc32)
                    at += rows.size
        self.blocks = at

    def tiles_in(self, number: int) -> int:
        """How many tiles a page has."""
        size = 1 << self.page_bits
        return int(min(size, self.tile_count - number * size))

    def tiles(self, data: bytes, number: int) -> list[Tile]:
        """The tiles of a page."""
        reader = _opened(data, self.tile_pages[number])
        n = self.tiles_in(number)
        depths, shifts = reader.take(n), reader.take(n)
        out, past = [], self.pages[number].base
        for depth, shift in zip(depths, shifts, strict=True):
            free = 3 * (DEEPEST - depth)
            require(free >= 0, "tile-depth")
            floor = -(-past >> free)
            prefix = floor + reader.varint(63)
            past = prefix + 1 << free
            out.append(Tile(depth, shift, prefix))
        reader.finish()
        return out

    def rows(self, data: bytes, layer: int, number: int) -> list[tuple[int, int, int, int]]:
        """Tile, length, count and CRC-32 of the TILE blocks of a page in a layer."""
        if (layer, number) not in self.row_pages:
            return []
        reader = _opened(data, self.row_pages[layer, number])
        lengths = [reader.varint(53) for _ in range(self.tiles_in(number))]
        there = [tile for tile, length in enumerate(lengths) if length]
        counts = [reader.varint(32) for _ in there]
        crcs = reader.fields(f"{len(there)}I")
        reader.finish()
        first = number << self.page_bits
        return [(first + t, lengths[t], count, crc) for t, count, crc in zip(there, counts, crcs, strict=True)]


def _models(reader: Payload) -> list[tuple[int, int, int, int, int]]:
    """Kind, flags, length, count and CRC-32 of the blocks of a layer that belong to no tile."""
    rows = reader.varint(8)
    return [(*reader.fields("BB"), reader.varint(53), reader.varint(32), *reader.fields("I")) for _ in range(rows)]


def _rows(reader: Payload) -> _Rows:
    size = reader.varint(32)
    if size == 0:
        return _Rows(0, 0, 0, 0)
    return _Rows(size, reader.fields("I")[0], reader.varint(53), reader.varint(53))


def _opened(data: bytes, page: Span) -> Payload:
    body = data[page.start : page.past]
    require(zlib.crc32(body) == page.crc32, "page-crc-mismatch")
    return Payload(body)


def read_tiles(data: bytes, root: Root) -> list[Tile]:
    """All tiles."""
    return [tile for number in range(len(root.pages)) for tile in root.tiles(data, number)]


def read_entries(data: bytes, root: Root) -> list[Entry]:
    """An entry for every block, in the order in which they lie: by layer, kind, tile."""
    out: list[Entry] = []
    at = root.blocks
    for layer, models in enumerate(root.models, start=1):
        rows = [(kind, flags, NO_TILE, *row) for kind, flags, *row in models if kind < TILE]
        for number in range(len(root.pages)):
            rows += [(TILE, 1, *row) for row in root.rows(data, layer, number)]
        rows += [(kind, flags, NO_TILE, *row) for kind, flags, *row in models if kind > TILE]
        for kind, flags, tile, length, count, crc in rows:
            out.append(Entry(kind, flags, layer, tile, at, length, count, crc))
            at += length
    return out
