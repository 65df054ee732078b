"""Files that break exactly one rule of ROOT (SPEC §5.4), its checksum right unless that is the fault."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from conformance.scenes.cases import Case, refused
from conformance.scenes.container_scenes import many_pages_file, paged_file, plain_file
from conformance.surgery.parts import (
    TILE_KIND,
    Change,
    Parts,
    block_added,
    broken,
    flipped,
    header_with,
    remade,
    repaged,
    rerooted,
    taken_apart,
)
from conformance.writer.fields import varint
from conformance.writer.pages import ModelRow, Pages, RootPage, RootRow

_LAYER, _METADATA = 1, 64
_MOST = (1 << 53) - 1
RootChange = Callable[[Pages], object]


def root_faults() -> Iterator[Case]:
    """In the order of the rules."""
    yield from _checksum_faults()
    yield from _structure_faults()
    yield from _entry_faults()
    yield from _page_faults()
    yield from _sum_faults()
    yield from _length_faults()
    yield from _critical_faults()


def _case(name: str, purpose: str, rule: str, refusal: str, data: bytes) -> Case:
    return refused(name, purpose, rule, refusal, data, "container")


# ------------------------------------------------------------------------------------------------ bytes


def _checksum_faults() -> Iterator[Case]:
    base = paged_file()
    header = taken_apart(base).header
    start, past = header["header_length"], header["header_length"] + header["root_length"]
    yield _case("root-bit", "one bit of ROOT is flipped", "R-5.4-2", "directory-crc-mismatch", flipped(base, past - 1))
    yield _case("root-first-bit", "one bit of the first byte of ROOT is flipped", "R-5.4-2", "directory-crc-mismatch",
                flipped(base, start))
    parts = taken_apart(base)
    parts.header["root_crc32"] ^= 1 << 31
    yield _case("root-crc", "the CRC of ROOT is wrong", "R-5.4-2", "directory-crc-mismatch", parts.raw())


def _structure_faults() -> Iterator[Case]:
    base = paged_file()
    rows: tuple[tuple[str, str, str, bytes], ...] = (
        ("root-empty", "ROOT has no bytes", "payload-short", rerooted(base, lambda _: b"")),
        ("root-short", "the last byte of ROOT is missing", "payload-short", rerooted(base, lambda root: root[:-1])),
        ("root-long", "a byte after the last number of ROOT", "payload-long",
         rerooted(base, lambda root: root + b"\0")),
        ("root-tiles-more", "one tile more than ROOT has pages for", "payload-short",
         broken(base, header_with(tile_count=9))),
        ("root-tiles-fewer", "so few tiles that the last page is none", "payload-long",
         broken(base, header_with(tile_count=6))),
        ("root-page-bits-fewer", "pages of one tile, and a ROOT for pages of two", "payload-short",
         broken(base, header_with(page_bits=0))),
        ("root-page-bits-more", "pages of four tiles, and a ROOT for pages of two", "payload-long",
         broken(base, header_with(page_bits=2))),
    )
    for name, purpose, refusal, data in rows:
        yield Case(f"invalid/{name}", purpose, data, ("R-5.7-2", "R-5.4-3"), refusals=(refusal,), stage="container")
    for name, purpose, data in _varint_faults(base):
        yield Case(f"invalid/root-{name}", purpose, data, ("R-5.7-1", "R-5.4-3"), refusals=("bad-varint",),
                   stage="container")


def _varint_faults(base: bytes) -> Iterator[tuple[str, str, bytes]]:
    def first(change: Callable[[RootPage, RootRow], object]) -> bytes:
        """A number of page 0, or of its row page in layer 1, changed in ROOT."""
        return repaged(base, root=lambda pages: change(pages.root.pages[0], pages.root.pages[0].rows[0]))

    def model(change: Callable[[ModelRow], object]) -> bytes:
        return repaged(base, root=lambda pages: change(pages.root.models[1][0]))

    blocks = taken_apart(base).pages().root.models[0]
    yield ("blocks-two-bytes", "the number of blocks takes a byte too many",
           rerooted(base, lambda root: bytes([len(blocks) | 0x80, 0]) + root[1:]))
    yield "blocks-256", "256 blocks in layer 1", rerooted(base, lambda root: varint(256) + root[1:])
    yield "length-2-53", "a block of 2^53 bytes", model(lambda row: setattr(row, "length", _MOST + 1))
    yield "count-2-32", "a block of 2^32 elements", model(lambda row: setattr(row, "count", 1 << 32))
    yield "gap-2-63", "a gap of 2^63 before page 0", first(lambda page, _: setattr(page, "gap", 1 << 63))
    yield "tile-bytes-2-32", "a tile page of 2^32 bytes", first(lambda page, _: setattr(page, "tile_bytes", 1 << 32))
    yield "row-bytes-2-32", "a row page of 2^32 bytes", first(lambda _, row: setattr(row, "row_bytes", 1 << 32))
    yield "block-bytes-2-53", "2^53 bytes of TILE blocks", first(lambda _, row: setattr(row, "block_bytes", _MOST + 1))
    yield "anchors-2-53", "2^53 anchors of a page", first(lambda _, row: setattr(row, "anchors", _MOST + 1))


# ------------------------------------------------------------------------------------------------ entries


def _entry_faults() -> Iterator[Case]:
    """Fields of one entry; the file is consistent in everything else."""
    base = plain_file()
    rows: tuple[tuple[str, str, str, str, Change], ...] = (
        ("entry-kind-zero", "a block of kind 0", "R-5.4-4", "entry-kind", lambda p: p.insert(0, kind=0)),
        ("flags-layer-none", "a LAYER block that is not critical", "R-5.4-5", "entry-flags",
         lambda p: p.entry(_LAYER).update(flags=0)),
        ("flags-layer-copy", "a LAYER block that is safe to copy", "R-5.4-5", "entry-flags",
         lambda p: p.entry(_LAYER, 2).update(flags=2)),
        ("flags-metadata-none", "METADATA without a flag", "R-5.4-5", "entry-flags",
         lambda p: p.entry(_METADATA).update(flags=0)),
        ("flags-metadata-critical", "METADATA that is critical", "R-5.4-5", "entry-flags",
         lambda p: p.entry(_METADATA).update(flags=1)),
        ("flags-private-both", "a private block with both flags", "R-5.4-5", "entry-flags", block_added(flags=3)),
        ("flags-private-bit", "a reserved flag of a private block", "R-5.4-5", "entry-flags", block_added(flags=4)),
        ("flags-private-high", "the highest flag of a private block", "R-5.4-5", "entry-flags",
         block_added(flags=130)),
        ("flags-model-none", "a block of the reserved kind 15 that is not critical", "R-5.4-5", "entry-flags",
         lambda p: p.insert(4, kind=15, flags=0)),
        ("metadata-late", "METADATA in layer 2", "R-5.4-6", "entry-layer", _late_metadata),
        ("order-kinds", "TABLES before LAYER", "R-5.4-7", "entry-order", lambda p: p.swap(0, 1)),
        ("order-annotation", "an annotation before the last model of layer 2", "R-5.4-7", "entry-order",
         _early_annotation),
        ("entry-twice", "two METADATA blocks", "R-5.4-7", "entry-order", _twice),
        ("entry-empty", "a block of no bytes", "R-5.4-8", "entry-length", block_added(b"")),
        ("metadata-count", "the count of METADATA is 1", "R-5.4-10", "entry-count",
         lambda p: p.entry(_METADATA).update(count=1)),
    )
    for name, purpose, rule, refusal, change in rows:
        case = _case(name, purpose, rule, refusal, remade(base, change))
        # Of what is reserved: no reader ignores it.
        yield Case(**{**vars(case), "rules": (rule, "R-11-2")}) if refusal == "entry-flags" else case
    yield _case("entry-kind-tile", "a TILE block among the blocks of no tile", "R-5.4-4", "entry-kind",
                repaged(base, root=lambda pages: setattr(pages.root.models[0][-1], "kind", TILE_KIND)))
    for name, length in (("beyond", len(base) + 1), ("top", _MOST)):
        yield _case(f"entry-length-{name}", f"the last block of no tile has {length} bytes", "R-5.4-8", "entry-length",
                    repaged(base, root=_with_last_length(length)))


def _with_last_length(length: int) -> RootChange:
    return lambda pages: setattr(pages.root.models[1][-1], "length", length)


def _late_metadata(parts: Parts) -> None:
    row = parts.row(_METADATA)
    payload = parts.blocks[row]
    parts.remove(row)
    parts.add(payload, kind=_METADATA, flags=2, layer=2)


def _early_annotation(parts: Parts) -> None:
    parts.insert(parts.row(_LAYER, 2) + 1, kind=70, layer=2)


def _twice(parts: Parts) -> None:
    row = parts.row(_METADATA)
    parts.insert(row + 1, parts.blocks[row], **parts.entries[row])


# ------------------------------------------------------------------------------------------------ pages


def _of_page(page: int, **numbers: int) -> RootChange:
    """Numbers of a page in ROOT changed."""
    return lambda pages: vars(pages.root.pages[page]).update(numbers)


def _of_rows(page: int, layer: int, **more: int) -> RootChange:
    """Numbers of a row page in ROOT made larger."""

    def change(pages: Pages) -> None:
        row = vars(pages.root.pages[page].rows[layer - 1])
        row.update({name: row[name] + number for name, number in more.items()})

    return change


def _page_faults() -> Iterator[Case]:
    base = paged_file()
    gap = taken_apart(base).pages().root.pages[3].gap
    for name, purpose, change in (
        ("page-gap-none", "page 2 begins where page 1 does", _of_page(2, gap=0)),
        ("page-base-2-63", "the last page begins at 2^63", _of_page(3, gap=gap + 1)),
        ("page-base-beyond", "page 0 begins at 2^63 - 1, page 1 after that", _of_page(0, gap=(1 << 63) - 1)),
        ("page-base-wraps", "pages that begin at 2^63 - 1 and at 2^64 - 2, -2 as a signed number", _two_far_gaps),
    ):
        yield _case(name, purpose, "R-5.4-11", "tile-order", repaged(base, root=change))
    rows: tuple[tuple[str, str, RootChange], ...] = (
        ("page-tiles-few", "a tile page of five bytes for two tiles", _of_page(1, tile_bytes=5)),
        ("page-tiles-many", "a tile page of 23 bytes for two tiles", _of_page(1, tile_bytes=23)),
        ("page-last-tiles-many", "a tile page of twelve bytes for the one tile of the last page",
         _of_page(3, tile_bytes=12)),
        ("page-rows-few", "a row page of six bytes for two tiles", _of_rows(0, 1, row_bytes=-1)),
        ("page-rows-many", "a row page of 35 bytes for two tiles", _of_rows(0, 2, row_bytes=35 - 12)),
        ("page-last-rows-many", "a row page of 18 bytes for the one tile of the last page",
         _of_rows(3, 2, row_bytes=18 - 6)),
        ("page-rows-4-gib", "a row page of 2^32 - 1 bytes", _of_rows(2, 1, row_bytes=(1 << 32) - 1 - 12)),
    )
    for name, purpose, change in rows:
        yield _case(name, purpose, "R-5.4-12", "page-length", repaged(base, root=change))
    yield _case("page-no-bytes", "a row page whose blocks have no bytes", "R-5.4-13", "page-sums",
                repaged(base, root=_of_rows(2, 1, block_bytes=-96)))


def _two_far_gaps(pages: Pages) -> None:
    pages.root.pages[0].gap = pages.root.pages[1].gap = (1 << 63) - 1


# ------------------------------------------------------------------------------------------------ sums


def _sum_faults() -> Iterator[Case]:
    plain, base = plain_file(), paged_file()
    both = "layer-directory-bytes", "layer-directory-anchors"
    yield _case("layer-takes-byte", "summaries that give a byte of layer 2 to layer 1", "R-5.4-14", both[0],
                broken(plain, _byte_to_first))
    yield _case("model-bytes", "stream_bytes[0] has one byte of the TILE blocks", "R-5.4-14", both[0],
                broken(plain, _model_byte))
    yield _case("layer-takes-anchor", "summaries that give an anchor of layer 2 to layer 1", "R-5.4-14", both[1],
                broken(plain, _anchor_to_first))
    yield _case("page-byte-more", "a page of layer 2 says one byte more than the summary", "R-5.4-14", both[0],
                repaged(base, root=_of_rows(3, 2, block_bytes=1)))
    yield _case("page-anchor-more", "a page of layer 2 says one anchor more than the summary", "R-5.4-14", both[1],
                repaged(base, root=_of_rows(3, 2, anchors=1)))
    yield _case("tile-count-more", "a TILE block and its page say an anchor more than the summary", "R-5.4-14", both[1],
                broken(plain, lambda p: _more(p.entry(TILE_KIND, 2), "count")))
    many = many_pages_file(_MANY)
    for name, field, refusal in (("bytes", "block_bytes", both[0]), ("anchors", "anchors", both[1])):
        yield Case(f"invalid/page-{name}-wrap", f"{field} that sum to what they should modulo 2^64",
                   repaged(many, root=_wrapped(field)), ("R-5.4-14", "R-5.4-17"), refusals=(refusal,),
                   stage="container")


_MANY = 2050
"""Pages: 2048 of them reach 2^64 - 2048 with numbers of 53 bits."""


def _wrapped(field: str) -> RootChange:
    """2^64 more than there are: 2^53 - 1 more in each of 2048 pages, 2048 more in the last."""

    def change(pages: Pages) -> None:
        for page in pages.root.pages[:2048]:
            before = getattr(page.rows[0], field)
            setattr(page.rows[0], field, _MOST)
            _more(vars(pages.root.pages[-1].rows[0]), field, before + 1)

    return change


def _more(row: dict[str, int], field: str, more: int = 1) -> None:
    row[field] += more


def _streams(parts: Parts, layer: int, models: int, framing: int) -> None:
    sizes = parts.layers[layer]["stream_bytes"]
    parts.layers[layer]["stream_bytes"] = (sizes[0] + models, *sizes[1:12], sizes[12] + framing)


def _byte_to_first(parts: Parts) -> None:
    for layer, more in enumerate((1, -1)):
        parts.layers[layer]["byte_count"] += more
        _streams(parts, layer, more, 0)
    parts.layers[0]["end_offset"] += 1


def _model_byte(parts: Parts) -> None:
    _streams(parts, 1, 1, -1)


def _anchor_to_first(parts: Parts) -> None:
    for name in ("anchor_count", "gaussian_count"):
        parts.layers[0][name] += 1


# ------------------------------------------------------------------------------------------------ lengths, kinds


def _length_faults() -> Iterator[Case]:
    base = paged_file()
    yield _case("directory-hole", "four bytes between the last page and the first block", "R-5.4-15",
                "directory-length", _with_hole(base))
    yield _case("page-tiles-more", "ROOT gives a tile page one byte more than there is", "R-5.4-15", "directory-length",
                repaged(base, root=_of_page(0, tile_bytes=7)))
    yield _case("page-rows-fewer", "ROOT gives a row page one byte less than there is", "R-5.4-15", "directory-length",
                repaged(base, root=_of_rows(2, 1, row_bytes=-1)))


def _with_hole(base: bytes) -> bytes:
    parts = taken_apart(base)
    pages = parts.pages()
    return parts.joined(pages.root.packed(), pages.packed_pages() + bytes(4))


def _critical_faults() -> Iterator[Case]:
    base = plain_file()
    rows: tuple[tuple[str, str, Change], ...] = (
        ("critical-model", "a critical block of the reserved kind 9", lambda p: p.insert(4, kind=9, flags=1)),
        ("critical-reserved", "a critical block of the reserved kind 17", lambda p: p.insert(7, kind=17, flags=1)),
        ("critical-annotation", "a critical annotation", lambda p: p.insert(8, kind=65, flags=1)),
        ("critical-late", "a critical private block in layer 2", block_added(layer=2, flags=1)),
    )
    for name, purpose, change in rows:
        yield _case(name, purpose, "R-5.4-16", "unknown-critical-block", remade(base, change))
