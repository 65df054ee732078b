"""Lies in ROOT, tile pages and row pages (SPEC §5.4, §5.5), behind checksums that are right.

Numbers are set to special ones or their neighbours, as in :mod:`.field_mutators`, or bytes are changed as in
:mod:`.block_mutators`; a page may also take the place of another.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from random import Random
from typing import Any

from conformance.surgery.raw_pages import RawRows, RawTiles
from conformance.writer.pages import Pages
from fuzz.testing.block_mutators import altered, parts_of
from fuzz.testing.field_mutators import NotHere, special_number
from fuzz.testing.front import PAGE_BITS
from fuzz.testing.parts import Parts, put_together

_SIZES = {
    "kind": 1, "flags": 1, "length": 6, "count": 4, "crc32": 4, "gap": 8, "tile_bytes": 4, "tile_crc32": 4,
    "row_bytes": 4, "row_crc32": 4, "block_bytes": 6, "anchors": 6,
}  # fmt: skip
"""Bytes that a number of ROOT may have."""


def _lie(row: Any, rng: Random) -> None:
    """Some numbers of a row of ROOT set to others."""
    names = [name for name in vars(row) if name in _SIZES]
    for name in rng.sample(names, min(len(names), rng.choice((1, 1, 1, 2)))):
        setattr(row, name, special_number(rng, _SIZES[name], getattr(row, name)))


def _chosen(items: Sequence[Any], rng: Random) -> Any:
    if not items:
        raise NotHere
    return rng.choice(items)


def root_entry(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """A number of a block that belongs to no tile."""
    parts = parts_of(data)
    return put_together(parts, lambda pages: _lie(_chosen([row for m in pages.root.models for row in m], rng), rng))


def root_page(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """A number that ROOT has of a page, or of its rows in a layer."""

    def change(pages: Pages) -> None:
        page = _chosen(pages.root.pages, rng)
        there = [row for row in page.rows if row.row_bytes]
        _lie(rng.choice([page, *there, *there]), rng)

    return put_together(_smaller(data, rng), change)


def root_bytes(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """Bytes or varints of ROOT."""
    return put_together(parts_of(data), change_root=lambda root: altered(root, rng))


def _smaller(data: bytes, rng: Random) -> Parts:
    """The parts of a file, perhaps in pages of one or two tiles: most small files have a single page."""
    parts = parts_of(data)
    bits = rng.choice((0, 0, 1, parts.header[PAGE_BITS]))
    parts.header = parts.header[:PAGE_BITS] + bytes([bits]) + parts.header[PAGE_BITS + 1 :]
    return parts


def page_alike(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """Copy a page's fields in ROOT, or those of its rows in a layer, to another page: one beginning, equal bytes."""

    def change(pages: Pages) -> None:
        groups: list[tuple[Sequence[Any], tuple[list[str], ...]]] = [
            (pages.root.pages, (["gap"], ["tile_bytes", "tile_crc32"], ["rows"])),
            ([row for page in pages.root.pages for row in page.rows], (["row_bytes", "row_crc32"], ["block_bytes"])),
        ]
        rows, names = _chosen([group for group in groups if len(group[0]) > 1], rng)
        source, target = rng.sample(rows, 2)
        vars(target).update({name: vars(source)[name] for name in rng.choice((*names, list(vars(source))))})

    return put_together(_smaller(data, rng), change)


def _settled(change: Callable[[Pages], None]) -> Callable[[Pages], None]:
    """The change, and then ROOT right about lengths and checksums of pages."""

    def both(pages: Pages) -> None:
        change(pages)
        pages.settle()

    return both


def _number(columns: Sequence[list[int]], sizes: Sequence[int], rng: Random) -> None:
    """A number of a column set to another."""
    filled = [(column, size) for column, size in zip(columns, sizes, strict=True) if column]
    column, size = _chosen(filled, rng)
    at = rng.randrange(len(column))
    column[at] = special_number(rng, size, column[at])


def tile_number(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """A depth, a shift or a gap of a tile."""

    def change(pages: Pages) -> None:
        page = _chosen(pages.tiles, rng)
        _number((page.depths, page.shifts, page.gaps), (1, 1, 8), rng)

    return put_together(_smaller(data, rng), _settled(change))


def repeat_tiles(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """Depth, shift or gap of a tile, or all of them, as another of its page has them."""

    def change(pages: Pages) -> None:
        page = _chosen([page for page in pages.tiles if len(page.depths) > 1], rng)
        source, target = rng.sample(range(len(page.depths)), 2)
        columns = (page.depths, page.shifts, page.gaps)
        for column in rng.choice(([page.depths], [page.gaps], columns)):
            column[target] = column[source]

    return put_together(parts_of(data), _settled(change))


def _rows(pages: Pages) -> list[tuple[int, int]]:
    """Layer, from 0, and page of every row page that there is."""
    return [(k, p) for k, layer in enumerate(pages.rows) for p, page in enumerate(layer) if page is not None]


def row_number(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """A length, a count or a CRC of a TILE block."""

    def change(pages: Pages) -> None:
        layer, number = _chosen(_rows(pages), rng)
        page = pages.rows[layer][number]
        assert page is not None
        _number((page.lengths, page.counts, page.crcs), (6, 4, 4), rng)

    return put_together(_smaller(data, rng), _settled(change))


def page_bytes(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """Bytes or varints of a tile page or a row page."""

    def change(pages: Pages) -> None:
        layer, number = _chosen([*((None, p) for p in range(len(pages.tiles))), *_rows(pages)], rng)
        if layer is None:
            pages.tiles[number] = RawTiles([], [], [], altered(pages.tiles[number].packed(), rng))
            return
        page = pages.rows[layer][number]
        assert page is not None
        pages.rows[layer][number] = RawRows([], [], [], altered(page.packed(), rng))

    return put_together(_smaller(data, rng), _settled(change))


OPERATORS: dict[str, Callable[[bytes, Random, Sequence[bytes]], bytes]] = {
    "root-entry": root_entry,
    "root-page": root_page,
    "root-bytes": root_bytes,
    "page-alike": page_alike,
    "tile-number": tile_number,
    "repeat-tiles": repeat_tiles,
    "row-number": row_number,
    "page-bytes": page_bytes,
}
