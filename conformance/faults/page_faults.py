"""Files that break exactly one rule of a tile page or a row page (SPEC §5.5), ROOT right unless it is the fault."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from conformance.scenes.cases import Case, refused
from conformance.scenes.container_scenes import paged_file, plain_file, root_file
from conformance.surgery.parts import flipped, repaged, taken_apart
from conformance.surgery.raw_pages import RawRows, RawTiles
from conformance.writer.fields import varint
from conformance.writer.pages import Pages, RowPage

PageChange = Callable[[Pages], object]
_MAX_BLOCK = 1 << 31


def page_faults() -> Iterator[Case]:
    """In the order of the rules."""
    yield from _checksum_faults()
    yield from _tile_structure_faults()
    yield from _row_structure_faults()
    yield from _tile_faults()
    yield from _order_faults()
    yield from _row_faults()


def _case(name: str, purpose: str, rule: str, refusal: str, data: bytes) -> Case:
    return refused(name, purpose, rule, refusal, data, "container")


# ------------------------------------------------------------------------------------------------ bytes


def _checksum_faults() -> Iterator[Case]:
    base = paged_file()
    parts = taken_apart(base)
    start = parts.header["header_length"] + parts.root_length
    rule = "R-5.5-1", "page-crc-mismatch"
    yield _case("tile-page-bit", "one bit of the first tile page is flipped", *rule, flipped(base, start))
    yield _case("row-page-bit", "one bit of the last row page is flipped", *rule,
                flipped(base, start + parts.pages_length - 1))
    yield _case("tile-page-crc", "ROOT has a wrong CRC for the tile page of tiles without blocks", *rule,
                repaged(base, root=lambda pages: _flip(pages, 1, None)))
    yield _case("row-page-crc", "ROOT has a wrong CRC for a row page of layer 2", *rule,
                repaged(base, root=lambda pages: _flip(pages, 0, 2)))


def _flip(pages: Pages, page: int, layer: int | None) -> None:
    root = pages.root.pages[page]
    if layer is None:
        root.tile_crc32 ^= 1
    else:
        root.rows[layer - 1].row_crc32 ^= 1


def _tiles_as(page: int, change: Callable[[bytes], bytes]) -> bytes:
    """The paged file with the bytes of a tile page changed."""

    def changed(pages: Pages) -> None:
        pages.tiles[page] = RawTiles([], [], [], change(pages.tiles[page].packed()))

    return repaged(paged_file(), changed)


def _rows_as(layer: int, page: int, change: Callable[[bytes], bytes]) -> bytes:
    """The paged file with the bytes of a row page changed."""

    def changed(pages: Pages) -> None:
        rows = pages.rows[layer - 1][page]
        assert rows is not None
        pages.rows[layer - 1][page] = RawRows([], [], [], change(rows.packed()))

    return repaged(paged_file(), changed)


def _structure_case(name: str, purpose: str, refusal: str, data: bytes) -> Case:
    rule = "R-5.7-1" if refusal == "bad-varint" else "R-5.7-2"
    return Case(f"invalid/{name}", purpose, data, (rule, "R-5.5-2"), refusals=(refusal,), stage="container")


def _tile_structure_faults() -> Iterator[Case]:
    rows: tuple[tuple[str, str, str, bytes], ...] = (
        ("tile-page-short", "the last gap of a tile page is not ended", "payload-short",
         _tiles_as(0, lambda page: page[:-1] + bytes([page[-1] | 0x80]))),
        ("tile-page-long", "a byte after the last gap of a tile page", "payload-long",
         _tiles_as(2, lambda page: page + b"\0")),
        ("tile-page-gap-two-bytes", "a gap that takes a byte too many", "bad-varint",
         _tiles_as(0, lambda page: page[:-1] + bytes([page[-1] | 0x80, 0]))),
        ("tile-page-gap-2-63", "a gap of 2^63 between two tiles of a page", "bad-varint",
         _tiles_as(2, lambda page: page[:5] + varint(1 << 63))),
    )
    for name, purpose, refusal, data in rows:
        yield _structure_case(name, purpose, refusal, data)


def _row_structure_faults() -> Iterator[Case]:
    # Of layer 2, page 0: two lengths and two counts of a byte each, two CRCs.
    rows: tuple[tuple[str, str, str, bytes], ...] = (
        ("row-page-short", "the last byte of a row page is missing", "payload-short",
         _rows_as(2, 0, lambda page: page[:-1])),
        ("row-page-long", "a byte after the last CRC of a row page", "payload-long",
         _rows_as(2, 3, lambda page: page + b"\0")),
        ("row-page-idle-count", "a count and a CRC for a tile without a block", "payload-long",
         _rows_as(1, 0, lambda page: page[:3] + b"\0" + page[3:] + bytes(4))),
        ("row-page-no-lengths", "a row page whose lengths are all 0", "payload-long",
         _rows_as(1, 2, lambda page: b"\0\0" + page[2:])),
        ("row-page-length-two-bytes", "a length that takes a byte too many", "bad-varint",
         _rows_as(1, 0, lambda page: bytes([page[0] | 0x80, 0]) + page[1:])),
        ("row-page-zero-two-bytes", "a length of 0 in two bytes", "bad-varint",
         _rows_as(1, 0, lambda page: page[:1] + b"\x80\0" + page[2:])),
        ("row-page-length-2-53", "a length of 2^53", "bad-varint",
         _rows_as(2, 0, lambda page: varint(1 << 53) + page[1:])),
        ("row-page-count-2-32", "a count of 2^32", "bad-varint",
         _rows_as(2, 0, lambda page: page[:2] + varint(1 << 32) + page[3:])),
    )
    for name, purpose, refusal, data in rows:
        yield _structure_case(name, purpose, refusal, data)


# ------------------------------------------------------------------------------------------------ tiles


def _tile(base: bytes, page: int, tile: int, **numbers: int) -> bytes:
    """The file with `depth`, `shift` or `gap` of a tile of a page changed, the page's bytes and CRC right."""

    def change(pages: Pages) -> None:
        columns = {"depth": pages.tiles[page].depths, "shift": pages.tiles[page].shifts, "gap": pages.tiles[page].gaps}
        for name, number in numbers.items():
            columns[name][tile] = number

    return repaged(base, change)


def _tile_faults() -> Iterator[Case]:
    plain, base, root = plain_file(), paged_file(), root_file()
    rows: tuple[tuple[str, str, str, str, bytes], ...] = (
        ("tile-depth-22", "depth 22, with local bits in range", "R-5.5-3", "tile-depth",
         _tile(base, 3, 0, depth=22, shift=5)),
        ("tile-depth-255", "depth 255", "R-5.5-3", "tile-depth", _tile(plain, 0, 2, depth=255)),
        ("tile-shift-32", "shift 32, with 0 local bits", "R-5.5-4", "tile-shift", _tile(root, 0, 0, shift=32)),
        ("tile-shift-high", "shift 255", "R-5.5-4", "tile-shift", _tile(base, 1, 1, shift=255)),
        ("tile-local-22", "22 local bits", "R-5.5-5", "tile-local-bits", _tile(plain, 0, 2, shift=9)),
        ("tile-too-deep", "local bits below 0", "R-5.5-5", "tile-local-bits", _tile(base, 2, 1, shift=12)),
        ("tile-prefix-root", "a prefix that is not 0 at depth 0", "R-5.5-6", "tile-prefix",
         _tile(root, 0, 0, gap=1)),
        ("tile-prefix-large", "a prefix of 4 bits at depth 1", "R-5.5-6", "tile-prefix", _tile(plain, 0, 2, gap=5)),
        ("tile-prefix-shifted-out", "a prefix of 16 at depth 1: all of it is beyond the 64 bits of `first`", "R-5.5-6",
         "tile-prefix", _tile(plain, 0, 2, gap=13)),
        ("tile-prefix-2-63", "a prefix of 2^63 at depth 21", "R-5.5-6", "tile-prefix",
         _tile(base, 2, 1, gap=(1 << 63) - (4 << 60))),
        ("tile-prefix-top", "a gap of 2^63 - 1 at depth 21: the prefix is beyond signed 64 bits", "R-5.5-6",
         "tile-prefix", _tile(base, 2, 1, gap=(1 << 63) - 1)),
        ("tile-prefix-after-end", "a tile after one that ends at 2^63", "R-5.5-6", "tile-prefix",
         _tile(base, 2, 0, gap=4)),
    )
    for name, purpose, rule, refusal, data in rows:
        yield _case(name, purpose, rule, refusal, data)


def _order_faults() -> Iterator[Case]:
    base = paged_file()

    def moved(page: int, more: int) -> bytes:
        """The file in which a page begins later, and the next where it did."""

        def change(pages: Pages) -> None:
            pages.root.pages[page].gap += more
            if page + 1 < len(pages.root.pages):
                pages.root.pages[page + 1].gap -= more

        return repaged(base, root=change)

    rows: tuple[tuple[str, str, bytes], ...] = (
        ("page-first-gap", "the first tile of a page begins one cube after the page", _tile(base, 1, 0, gap=1)),
        ("page-base-odd", "a page begins one code before its first tile", moved(1, -1)),
        ("page-base-inside", "a page begins within a cube of its first tile's depth", moved(2, 1)),
        ("page-overlap", "a tile page ends one code after the next begins", _overlapping(1)),
        ("page-overlap-far", "the last tile of a page lies behind the page after the next",
         _tile(base, 0, 1, depth=1, gap=2)),
    )
    for name, purpose, data in rows:
        yield _case(name, purpose, "R-5.5-7", "tile-order", data)


def _overlapping(codes: int) -> bytes:
    """Page 1 begins so many codes before the end of page 0."""
    tiles = taken_apart(paged_file()).tiles
    past = tiles[1]["prefix"] + 1 << 3 * (21 - tiles[1]["depth"])

    def change(pages: Pages) -> None:
        before = pages.root.pages[1].gap
        pages.root.pages[1].gap = past - codes
        pages.root.pages[2].gap += before - (past - codes)

    return repaged(paged_file(), root=change)


# ------------------------------------------------------------------------------------------------ rows


def _row(layer: int, page: int, change: Callable[[RowPage], object]) -> bytes:
    """The paged file with a row page changed, its bytes and CRC right."""

    def changed(pages: Pages) -> None:
        rows = pages.rows[layer - 1][page]
        assert rows is not None
        change(rows)

    return repaged(paged_file(), changed)


def _add(numbers: list[int], place: int, more: int) -> None:
    numbers[place] += more


def _row_faults() -> Iterator[Case]:
    limits = ("R-13.1-1",)
    for name, purpose, rule, refusal, data in (
        ("limit-tile-block-bytes", "a TILE block of 2^31 + 1 bytes", "R-5.5-8", "limit-block-bytes",
         _row(2, 0, lambda rows: _add(rows.lengths, 0, _MAX_BLOCK + 1 - rows.lengths[0]))),
        ("limit-tile-block-bytes-top", "a TILE block of 2^53 - 1 bytes", "R-5.5-8", "limit-block-bytes",
         _row(1, 2, lambda rows: _add(rows.lengths, 1, (1 << 53) - 1 - rows.lengths[1]))),
        ("limit-tile-anchors-top", "a TILE block that says 2^32 - 1 anchors", "R-5.5-9", "limit-tile-anchors",
         _row(2, 0, lambda rows: _add(rows.counts, 0, (1 << 32) - 1 - rows.counts[0]))),
    ):
        yield Case(f"invalid/{name}", purpose, data, (rule, *limits), refusals=(refusal,), stage="container")
    sums = "R-5.5-10", "page-sums"
    yield _case("row-byte-more", "the lengths of a page sum to a byte more than ROOT says", *sums,
                _row(1, 0, lambda rows: _add(rows.lengths, 0, 1)))
    yield _case("row-byte-less", "the lengths of a page sum to a byte less than ROOT says", *sums,
                _row(2, 3, lambda rows: _add(rows.lengths, 0, -1)))
    yield _case("row-anchor-more", "the counts of a page sum to one more than ROOT says", *sums,
                _row(2, 0, lambda rows: _add(rows.counts, 1, 1)))
    for field, what in (("block_bytes", "byte"), ("anchors", "anchor")):
        yield _case(f"page-takes-{what}", f"ROOT gives one {what} of page 2 to page 0", *sums, _given(field))


def _given(field: str) -> bytes:
    def change(pages: Pages) -> None:
        for page, more in ((0, 1), (2, -1)):
            row = pages.root.pages[page].rows[0]
            setattr(row, field, getattr(row, field) + more)

    return repaged(paged_file(), root=change)
