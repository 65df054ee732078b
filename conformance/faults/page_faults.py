"""Files that break exactly one rule of a tile page or a row page (SPEC §5.5), ROOT right unless it is the fault."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from conformance.scenes.cases import Case, Fault, refuse
from conformance.scenes.container_scenes import paged_file, plain_file, root_file
from conformance.surgery.edit import Changes, append, cut, more, plus, splice
from conformance.surgery.parts import change_pages, flip_bits, take_apart
from conformance.writer.pages import RawPage
from scarfmt.container.bytefields import unsigned_varint as varint

_MAX_BLOCK = 1 << 31


def page_faults() -> Iterator[Case]:
    """In the order of the rules."""
    base = paged_file()
    for faults in (_checksum_faults(base), _structure_faults(base), _tile_faults(base), _order_faults(base),
                   _row_faults(base)):
        yield from (refuse(*fault, stage="container") for fault in faults)


# ------------------------------------------------------------------------------------------------ bytes


def _checksum_faults(base: bytes) -> Iterator[Fault]:
    parts = take_apart(base)
    start = parts.header["header_length"] + parts.root_length
    for name, purpose, data in (
        ("tile-page-bit", "one bit of the first tile page is flipped", flip_bits(base, start)),
        ("row-page-bit", "one bit of the last row page is flipped", flip_bits(base, start + parts.pages_length - 1)),
        ("tile-page-crc", "ROOT has a wrong CRC for the tile page of tiles without blocks",
         change_pages(base, root={"root.pages.1.tile_crc32": lambda crc: crc ^ 1})),
        ("row-page-crc", "ROOT has a wrong CRC for a row page of layer 2",
         change_pages(base, root={"root.pages.0.rows.1.row_crc32": lambda crc: crc ^ 1})),
    ):
        yield name, purpose, "R-5.5-1", "page-crc-mismatch", data


def _structure_faults(base: bytes) -> Iterator[Fault]:
    """Bytes of a tile page, or, of a layer and a page, of a row page."""

    def raw(place: tuple[int, ...], change: Callable[[bytes], bytes]) -> bytes:
        path = f"tiles.{place[0]}" if len(place) == 1 else f"rows.{place[0] - 1}.{place[1]}"
        return change_pages(base, {path: lambda page: RawPage(change(page.pack()))})

    # Of layer 2, page 0: two lengths and two counts of a byte each, two CRCs.
    rows: tuple[tuple[str, str, str, tuple[int, ...], Callable[[bytes], bytes]], ...] = (
        ("tile-page-short", "the last gap of a tile page is not ended", "payload-short", (0,),
         lambda page: page[:-1] + bytes([page[-1] | 0x80])),
        ("tile-page-long", "a byte after the last gap of a tile page", "payload-long", (2,), append()),
        ("tile-page-gap-two-bytes", "a gap that takes a byte too many", "bad-varint", (0,),
         lambda page: page[:-1] + bytes([page[-1] | 0x80, 0])),
        ("tile-page-gap-2-63", "a gap of 2^63 between two tiles of a page", "bad-varint", (2,),
         lambda page: page[:5] + varint(1 << 63)),
        ("row-page-short", "the last byte of a row page is missing", "payload-short", (2, 0), cut),
        ("row-page-long", "a byte after the last CRC of a row page", "payload-long", (2, 3), append()),
        ("row-page-idle-count", "a count and a CRC for a tile without a block", "payload-long", (1, 0),
         lambda page: page[:3] + b"\0" + page[3:] + bytes(4)),
        ("row-page-no-lengths", "a row page whose lengths are all 0", "payload-long", (1, 2), splice(0, b"\0\0", 2)),
        ("row-page-length-two-bytes", "a length that takes a byte too many", "bad-varint", (1, 0),
         lambda page: bytes([page[0] | 0x80, 0]) + page[1:]),
        ("row-page-zero-two-bytes", "a length of 0 in two bytes", "bad-varint", (1, 0), splice(1, b"\x80\0")),
        ("row-page-length-2-53", "a length of 2^53", "bad-varint", (2, 0), splice(0, varint(1 << 53))),
        ("row-page-count-2-32", "a count of 2^32", "bad-varint", (2, 0), splice(2, varint(1 << 32))),
    )
    for name, purpose, refusal, place, change in rows:
        rule = "R-5.7-1" if refusal == "bad-varint" else "R-5.7-2"
        yield name, purpose, f"{rule} R-5.5-2", refusal, raw(place, change)


# ------------------------------------------------------------------------------------------------ tiles


def _tile_faults(base: bytes) -> Iterator[Fault]:
    plain, root = plain_file(), root_file()
    depth, shift, local, prefix = (("R-5.5-3", "tile-depth"), ("R-5.5-4", "tile-shift"),
                                   ("R-5.5-5", "tile-local-bits"), ("R-5.5-6", "tile-prefix"))
    rows: tuple[tuple[str, str, tuple[str, str], bytes, Changes], ...] = (
        ("depth-22", "depth 22, with local bits in range", depth, base,
         {"tiles.3.depths.0": 22, "tiles.3.shifts.0": 5}),
        ("depth-255", "depth 255", depth, plain, {"tiles.0.depths.2": 255}),
        ("shift-32", "shift 32, with 0 local bits", shift, root, {"tiles.0.shifts.0": 32}),
        ("shift-high", "shift 255", shift, base, {"tiles.1.shifts.1": 255}),
        ("local-22", "22 local bits", local, plain, {"tiles.0.shifts.2": 9}),
        ("too-deep", "local bits below 0", local, base, {"tiles.2.shifts.1": 12}),
        ("prefix-root", "a prefix that is not 0 at depth 0", prefix, root, {"tiles.0.gaps.0": 1}),
        ("prefix-large", "a prefix of 4 bits at depth 1", prefix, plain, {"tiles.0.gaps.2": 5}),
        ("prefix-shifted-out", "a prefix of 16 at depth 1: all of it is beyond the 64 bits of `first`", prefix, plain,
         {"tiles.0.gaps.2": 13}),
        ("prefix-2-63", "a prefix of 2^63 at depth 21", prefix, base, {"tiles.2.gaps.1": (1 << 63) - (4 << 60)}),
        ("prefix-top", "a gap of 2^63 - 1 at depth 21: the prefix is beyond signed 64 bits", prefix, base,
         {"tiles.2.gaps.1": (1 << 63) - 1}),
        ("prefix-after-end", "a tile after one that ends at 2^63", prefix, base, {"tiles.2.gaps.0": 4}),
    )
    for name, purpose, rule, data, changes in rows:
        yield f"tile-{name}", purpose, *rule, change_pages(data, changes)


def _order_faults(base: bytes) -> Iterator[Fault]:
    parts = take_apart(base)
    before, past = parts.pages().root.pages[1].gap, parts.tiles[1]["prefix"] + 1 << 3 * (21 - parts.tiles[1]["depth"])
    # Where a page begins later, the next begins where it did.
    rows: tuple[tuple[str, str, Changes, Changes], ...] = (
        ("page-first-gap", "the first tile of a page begins one cube after the page", {"tiles.1.gaps.0": 1}, {}),
        ("page-base-odd", "a page begins one code before its first tile", {},
         {"root.pages.1.gap": plus(-1), "root.pages.2.gap": more}),
        ("page-base-inside", "a page begins within a cube of its first tile's depth", {},
         {"root.pages.2.gap": more, "root.pages.3.gap": plus(-1)}),
        ("page-overlap", "a tile page ends one code after the next begins", {},
         {"root.pages.1.gap": past - 1, "root.pages.2.gap": plus(before - (past - 1))}),
        ("page-overlap-far", "the last tile of a page lies behind the page after the next",
         {"tiles.0.depths.1": 1, "tiles.0.gaps.1": 2}, {}),
    )
    for name, purpose, contents, root in rows:
        yield name, purpose, "R-5.5-7", "tile-order", change_pages(base, contents, root)


# ------------------------------------------------------------------------------------------------ rows


def _row_faults(base: bytes) -> Iterator[Fault]:
    large, sums = ("R-5.5-8 R-13.1-1", "limit-block-bytes"), ("R-5.5-10", "page-sums")
    rows: tuple[tuple[str, str, tuple[str, str], Changes, Changes], ...] = (
        ("limit-tile-block-bytes", "a TILE block of 2^31 + 1 bytes", large, {"rows.1.0.lengths.0": _MAX_BLOCK + 1}, {}),
        ("limit-tile-block-bytes-top", "a TILE block of 2^53 - 1 bytes", large,
         {"rows.0.2.lengths.1": (1 << 53) - 1}, {}),
        ("limit-tile-anchors-top", "a TILE block that says 2^32 - 1 anchors",
         ("R-5.5-9 R-13.1-1", "limit-tile-anchors"), {"rows.1.0.counts.0": (1 << 32) - 1}, {}),
        ("row-byte-more", "the lengths of a page sum to a byte more than ROOT says", sums,
         {"rows.0.0.lengths.0": more}, {}),
        ("row-byte-less", "the lengths of a page sum to a byte less than ROOT says", sums,
         {"rows.1.3.lengths.0": plus(-1)}, {}),
        ("row-anchor-more", "the counts of a page sum to one more than ROOT says", sums,
         {"rows.1.0.counts.1": more}, {}),
        *((f"page-takes-{what}", f"ROOT gives one {what} of page 2 to page 0", sums, {},
           {f"root.pages.0.rows.0.{field}": more, f"root.pages.2.rows.0.{field}": plus(-1)})
          for field, what in (("block_bytes", "byte"), ("anchors", "anchor"))),
    )
    for name, purpose, rule, contents, root in rows:
        yield name, purpose, *rule, change_pages(base, contents, root)
