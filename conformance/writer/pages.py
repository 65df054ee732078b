"""ROOT, tile pages and row pages (SPEC §5.4, §5.5): numbers first, so that a fault can change each, then their bytes.

Nothing is checked. :func:`paged` is where the numbers of a sound file come from.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from scarfmt.container.bytefields import unsigned_varint as varint

DEEPEST = 21
PAGE_BITS = 10
"""The value that encoders should write (R-5.4-18)."""
TILE = 16

Cube = tuple[int, int, int]
"""Depth, shift and prefix of a tile."""


@dataclass
class ModelRow:
    """A block of no tile, as ROOT lists it."""

    kind: int
    flags: int
    length: int
    count: int
    crc32: int


@dataclass
class TileRow:
    """A TILE block: its layer and tile, and what its row page says of it."""

    layer: int
    tile: int
    length: int
    count: int
    crc32: int


@dataclass
class TilePage:
    """The three columns of a tile page."""

    depths: list[int]
    shifts: list[int]
    gaps: list[int]

    def pack(self) -> bytes:
        """The bytes of the page."""
        return bytes(self.depths) + bytes(self.shifts) + b"".join(map(varint, self.gaps))


@dataclass
class RowPage:
    """The columns of a row page: a length for every tile of the page, the others for every length that is not 0."""

    lengths: list[int]
    counts: list[int]
    crcs: list[int]

    def pack(self) -> bytes:
        """The bytes of the page."""
        numbers = b"".join(map(varint, (*self.lengths, *self.counts)))
        return numbers + struct.pack(f"<{len(self.crcs)}I", *self.crcs)


@dataclass
class RawPage:
    """A page of any bytes, for files whose directory is wrong."""

    data: bytes

    def pack(self) -> bytes:
        """The bytes of the page."""
        return self.data


@dataclass
class RootRow:
    """The fields of a row page in ROOT. If the page does not exist, `row_bytes` is 0, and so are the others."""

    row_bytes: int = 0
    row_crc32: int = 0
    block_bytes: int = 0
    anchors: int = 0


@dataclass
class RootPage:
    """The fields of a page in ROOT: of its tiles, and of its row page in every layer."""

    gap: int
    tile_bytes: int
    tile_crc32: int
    rows: list[RootRow]


@dataclass
class Root:
    """ROOT: `models` by layer, `pages` in order."""

    models: list[list[ModelRow]]
    pages: list[RootPage]

    def pack(self) -> bytes:
        """The bytes of ROOT."""
        out = []
        for rows in self.models:
            out.append(varint(len(rows)))
            for row in rows:
                numbers = varint(row.length) + varint(row.count)
                out += [bytes([row.kind, row.flags]), numbers, struct.pack("<I", row.crc32)]
        for page in self.pages:
            out += [varint(page.gap), varint(page.tile_bytes), struct.pack("<I", page.tile_crc32)]
            out += map(_row_bytes, page.rows)
        return b"".join(out)


def _row_bytes(row: RootRow) -> bytes:
    if not row.row_bytes:
        return varint(0)
    crc = struct.pack("<I", row.row_crc32)
    return varint(row.row_bytes) + crc + varint(row.block_bytes) + varint(row.anchors)


@dataclass
class Pages:
    """ROOT and the pages: `tiles` page by page; `rows` layer by layer, then page by page, None where there is none.

    Each is a :class:`TilePage` or :class:`RowPage`, or a :class:`RawPage`.
    """

    root: Root
    tiles: list[Any]
    rows: list[list[Any]]

    def settle(self) -> None:
        """Make right what ROOT says of the bytes of pages: their lengths and checksums, not the sums."""
        for number, (page, tiles) in enumerate(zip(self.root.pages, self.tiles, strict=True)):
            data = tiles.pack()
            page.tile_bytes, page.tile_crc32 = len(data), zlib.crc32(data)
            for row, layer in zip(page.rows, self.rows, strict=True):
                rows = layer[number]
                data = b"" if rows is None else rows.pack()
                row.row_bytes, row.row_crc32 = len(data), zlib.crc32(data)

    def pack_pages(self) -> bytes:
        """Tile pages, then the row pages of layer 1, of layer 2, and so on."""
        rows = [page.pack() for layer in self.rows for page in layer if page is not None]
        return b"".join([*(page.pack() for page in self.tiles), *rows])


def make_pages(
    cubes: Sequence[Cube], models: Sequence[Sequence[ModelRow]], blocks: Iterable[TileRow], page_bits: int
) -> Pages:
    """ROOT and pages of a file whose numbers are right.

    Args:
        models: by layer, the blocks of no tile in the order of the file.
        blocks: TILE blocks of any layer and tile that there is.

    Raises:
        ValueError: tiles that do not ascend or are not disjoint, which no gap can say.
    """
    size = 1 << page_bits
    found = {(row.layer, row.tile): row for row in blocks}
    pages = Pages(Root([list(rows) for rows in models], []), [], [[] for _ in models])
    before = 0
    for first in range(0, len(cubes), size):
        base, tiles = _tile_page(cubes[first : first + size])
        pages.tiles.append(tiles)
        root = RootPage(base - before, 0, 0, [])
        for layer, held in enumerate(pages.rows, start=1):
            own = [found.get((layer, tile)) for tile in range(first, min(first + size, len(cubes)))]
            held.append(_row_page(own))
            there = [row for row in own if row is not None]
            root.rows.append(RootRow(0, 0, sum(row.length for row in there), sum(row.count for row in there)))
        pages.root.pages.append(root)
        before = base
    pages.settle()
    return pages


def _tile_page(cubes: Sequence[Cube]) -> tuple[int, TilePage]:
    """The code at which the first tile begins, and the page."""
    depth, _, prefix = cubes[0]
    base = past = prefix << 3 * (DEEPEST - depth)
    gaps = []
    for depth, _, prefix in cubes:
        free = 3 * (DEEPEST - depth)
        floor = -(-past >> free)
        if prefix < floor:
            raise ValueError(f"tile {prefix} of depth {depth} begins before the end of the tile before")
        gaps.append(prefix - floor)
        past = prefix + 1 << free
    return base, TilePage([cube[0] for cube in cubes], [cube[1] for cube in cubes], gaps)


def _row_page(rows: Sequence[TileRow | None]) -> RowPage | None:
    there = [row for row in rows if row is not None]
    if not there:
        return None
    lengths = [0 if row is None else row.length for row in rows]
    return RowPage(lengths, [row.count for row in there], [row.crc32 for row in there])
