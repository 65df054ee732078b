"""Files that break exactly one rule of ROOT (SPEC §5.4), its checksum right unless that is the fault."""

from __future__ import annotations

from collections.abc import Iterator

from conformance.scenes.cases import Case, Fault, refuse
from conformance.scenes.container_scenes import many_pages_file, paged_file, plain_file
from conformance.surgery.edit import Changes, append, cut, more, plus, splice
from conformance.surgery.parts import (
    TILE_KIND,
    Change,
    Parts,
    block_added,
    change_pages,
    change_root,
    change_rows,
    entry_with,
    flip_bits,
    header_with,
    remake,
    take_apart,
)
from conformance.writer.pages import Pages
from scarfmt.container.bytefields import unsigned_varint as varint

_LAYER, _METADATA = 1, 64
_MOST = (1 << 53) - 1


def root_faults() -> Iterator[Case]:
    """In the order of the rules."""
    plain, paged = plain_file(), paged_file()
    for faults in (
        _checksum_faults(paged), _structure_faults(paged), _varint_faults(paged), _entry_faults(plain),
        _number_faults(plain, paged), _sum_faults(plain), _wrap_faults(),
    ):
        yield from (refuse(*fault, stage="container") for fault in faults)


# ------------------------------------------------------------------------------------------------ bytes


def _checksum_faults(base: bytes) -> Iterator[Fault]:
    header = take_apart(base).header
    start, past = header["header_length"], header["header_length"] + header["root_length"]
    parts = take_apart(base)
    parts.header["root_crc32"] ^= 1 << 31
    for name, purpose, data in (
        ("bit", "one bit of ROOT is flipped", flip_bits(base, past - 1)),
        ("first-bit", "one bit of the first byte of ROOT is flipped", flip_bits(base, start)),
        ("crc", "the CRC of ROOT is wrong", parts.raw()),
    ):
        yield f"root-{name}", purpose, "R-5.4-2", "directory-crc-mismatch", data


def _structure_faults(base: bytes) -> Iterator[Fault]:
    for name, purpose, refusal, data in (
        ("empty", "ROOT has no bytes", "payload-short", change_root(base, lambda _: b"")),
        ("short", "the last byte of ROOT is missing", "payload-short", change_root(base, cut)),
        ("long", "a byte after the last number of ROOT", "payload-long", change_root(base, append())),
        ("tiles-more", "one tile more than ROOT has pages for", "payload-short",
         change_rows(base, header_with(tile_count=9))),
        ("tiles-fewer", "so few tiles that the last page is none", "payload-long",
         change_rows(base, header_with(tile_count=6))),
        ("page-bits-fewer", "pages of one tile, and a ROOT for pages of two", "payload-short",
         change_rows(base, header_with(page_bits=0))),
        ("page-bits-more", "pages of four tiles, and a ROOT for pages of two", "payload-long",
         change_rows(base, header_with(page_bits=2))),
    ):
        yield f"root-{name}", purpose, "R-5.7-2 R-5.4-3", refusal, data


def _varint_faults(base: bytes) -> Iterator[Fault]:
    blocks = len(take_apart(base).pages().root.models[0])
    rows: tuple[tuple[str, str, bytes | Changes], ...] = (
        ("blocks-two-bytes", "the number of blocks takes a byte too many",
         change_root(base, splice(0, bytes([blocks | 0x80, 0])))),
        ("blocks-256", "256 blocks in layer 1", change_root(base, splice(0, varint(256)))),
        ("length-2-53", "a block of 2^53 bytes", {"root.models.1.0.length": _MOST + 1}),
        ("count-2-32", "a block of 2^32 elements", {"root.models.1.0.count": 1 << 32}),
        ("gap-2-63", "a gap of 2^63 before page 0", {"root.pages.0.gap": 1 << 63}),
        ("tile-bytes-2-32", "a tile page of 2^32 bytes", {"root.pages.0.tile_bytes": 1 << 32}),
        ("row-bytes-2-32", "a row page of 2^32 bytes", {"root.pages.0.rows.0.row_bytes": 1 << 32}),
        ("block-bytes-2-53", "2^53 bytes of TILE blocks", {"root.pages.0.rows.0.block_bytes": _MOST + 1}),
        ("anchors-2-53", "2^53 anchors of a page", {"root.pages.0.rows.0.anchors": _MOST + 1}),
    )
    for name, purpose, made in rows:
        data = made if isinstance(made, bytes) else change_pages(base, root=made)
        yield f"root-{name}", purpose, "R-5.7-1 R-5.4-3", "bad-varint", data


# ------------------------------------------------------------------------------------------------ entries


def _entry_faults(base: bytes) -> Iterator[Fault]:
    """Fields of one entry; the file is consistent in everything else."""
    # Of what is reserved: no reader ignores it.
    flags, order = ("R-5.4-5 R-11-2", "entry-flags"), ("R-5.4-7", "entry-order")
    critical = "R-5.4-16", "unknown-critical-block"
    rows: tuple[tuple[str, str, tuple[str, str], Change], ...] = (
        ("entry-kind-zero", "a block of kind 0", ("R-5.4-4", "entry-kind"), lambda p: p.insert(0, kind=0)),
        ("flags-layer-none", "a LAYER block that is not critical", flags, entry_with(_LAYER, flags=0)),
        ("flags-layer-copy", "a LAYER block that is safe to copy", flags, entry_with(_LAYER, 2, flags=2)),
        ("flags-metadata-none", "METADATA without a flag", flags, entry_with(_METADATA, flags=0)),
        ("flags-metadata-critical", "METADATA that is critical", flags, entry_with(_METADATA, flags=1)),
        ("flags-private-both", "a private block with both flags", flags, block_added(flags=3)),
        ("flags-private-bit", "a reserved flag of a private block", flags, block_added(flags=4)),
        ("flags-private-high", "the highest flag of a private block", flags, block_added(flags=130)),
        ("flags-model-none", "a block of the reserved kind 14 that is not critical", flags,
         lambda p: p.insert(4, kind=14, flags=0)),
        ("flags-thumbnail", "a thumbnail that is critical", flags, lambda p: p.insert(4, kind=15, flags=1)),
        ("metadata-late", "METADATA in layer 2", ("R-5.4-6", "entry-layer"), _late_metadata),
        ("order-kinds", "TABLES before LAYER", order, lambda p: p.swap(0, 1)),
        ("order-annotation", "an annotation before the last model of layer 2", order,
         lambda p: p.insert(p.row(_LAYER, 2) + 1, kind=70, layer=2)),
        ("entry-twice", "two METADATA blocks", order, _twice),
        ("entry-empty", "a block of no bytes", ("R-5.4-8", "entry-length"), block_added(b"")),
        ("metadata-count", "the count of METADATA is 1", ("R-5.4-10", "entry-count"), entry_with(_METADATA, count=1)),
        ("critical-model", "a critical block of the reserved kind 9", critical, lambda p: p.insert(2, kind=9, flags=1)),
        ("critical-reserved", "a critical block of the reserved kind 17", critical,
         lambda p: p.insert(5, kind=17, flags=1)),
        ("critical-annotation", "a critical annotation", critical, lambda p: p.insert(6, kind=65, flags=1)),
        ("critical-late", "a critical private block in layer 2", critical, block_added(layer=2, flags=1)),
    )
    for name, purpose, rule, change in rows:
        yield name, purpose, *rule, remake(base, change)


def _late_metadata(parts: Parts) -> None:
    row = parts.row(_METADATA)
    payload = parts.blocks[row]
    parts.remove(row)
    parts.add(payload, kind=_METADATA, flags=2, layer=2)


def _twice(parts: Parts) -> None:
    row = parts.row(_METADATA)
    parts.insert(row + 1, parts.blocks[row], **parts.entries[row])


# ------------------------------------------------------------------------------------------------ numbers


def _number_faults(plain: bytes, base: bytes) -> Iterator[Fault]:
    """Numbers of ROOT alone, of entries and of pages."""
    length, order, size = ("R-5.4-8", "entry-length"), ("R-5.4-11", "tile-order"), ("R-5.4-12", "page-length")
    sums, whole = "R-5.4-14", ("R-5.4-15", "directory-length")
    gap = take_apart(base).pages().root.pages[3].gap
    rows: tuple[tuple[str, str, tuple[str, str], bytes, Changes], ...] = (
        ("entry-kind-tile", "a TILE block among the blocks of no tile", ("R-5.4-4", "entry-kind"), plain,
         {"root.models.0.-1.kind": TILE_KIND}),
        ("entry-length-beyond", f"the last block of no tile has {2 * len(plain)} bytes", length, plain,
         {"root.models.1.-1.length": 2 * len(plain)}),
        ("entry-length-top", f"the last block of no tile has {_MOST} bytes", length, plain,
         {"root.models.1.-1.length": _MOST}),
        ("page-gap-none", "page 2 begins where page 1 does", order, base, {"root.pages.2.gap": 0}),
        ("page-base-2-63", "the last page begins at 2^63", order, base, {"root.pages.3.gap": gap + 1}),
        ("page-base-beyond", "page 0 begins at 2^63 - 1, page 1 after that", order, base,
         {"root.pages.0.gap": (1 << 63) - 1}),
        ("page-base-wraps", "pages that begin at 2^63 - 1 and at 2^64 - 2, -2 as a signed number", order, base,
         {"root.pages.0.gap": (1 << 63) - 1, "root.pages.1.gap": (1 << 63) - 1}),
        ("page-tiles-few", "a tile page of five bytes for two tiles", size, base, {"root.pages.1.tile_bytes": 5}),
        ("page-tiles-many", "a tile page of 23 bytes for two tiles", size, base, {"root.pages.1.tile_bytes": 23}),
        ("page-last-tiles-many", "a tile page of twelve bytes for the one tile of the last page", size, base,
         {"root.pages.3.tile_bytes": 12}),
        ("page-rows-few", "a row page of six bytes for two tiles", size, base,
         {"root.pages.0.rows.0.row_bytes": plus(-1)}),
        ("page-rows-many", "a row page of 35 bytes for two tiles", size, base,
         {"root.pages.0.rows.1.row_bytes": plus(35 - 12)}),
        ("page-last-rows-many", "a row page of 18 bytes for the one tile of the last page", size, base,
         {"root.pages.3.rows.1.row_bytes": plus(18 - 6)}),
        ("page-rows-4-gib", "a row page of 2^32 - 1 bytes", size, base,
         {"root.pages.2.rows.0.row_bytes": plus((1 << 32) - 1 - 12)}),
        ("page-no-bytes", "a row page whose blocks have no bytes", ("R-5.4-13", "page-sums"), base,
         {"root.pages.2.rows.0.block_bytes": plus(-96)}),
        ("page-byte-more", "a page of layer 2 says one byte more than the summary", (sums, "layer-directory-bytes"),
         base, {"root.pages.3.rows.1.block_bytes": more}),
        ("page-anchor-more", "a page of layer 2 says one anchor more than the summary",
         (sums, "layer-directory-anchors"), base, {"root.pages.3.rows.1.anchors": more}),
        ("page-tiles-more", "ROOT gives a tile page one byte more than there is", whole, base,
         {"root.pages.0.tile_bytes": 7}),
        ("page-rows-fewer", "ROOT gives a row page one byte less than there is", whole, base,
         {"root.pages.2.rows.0.row_bytes": plus(-1)}),
    )
    for name, purpose, rule, data, changes in rows:
        yield name, purpose, *rule, change_pages(data, root=changes)
    parts = take_apart(base)
    pages = parts.pages()
    yield ("directory-hole", "four bytes between the last page and the first block", *whole,
           parts.join(pages.root.pack(), pages.pack_pages() + bytes(4)))


def _sum_faults(plain: bytes) -> Iterator[Fault]:
    """Summaries of layers that do not sum up to what ROOT says."""
    sizes, anchors = ("R-5.4-14", "layer-directory-bytes"), ("R-5.4-14", "layer-directory-anchors")
    yield ("layer-takes-byte", "summaries that give a byte of layer 2 to layer 1", *sizes, change_rows(plain, {
        "layers.0.byte_count": more, "layers.0.stream_bytes.0": more, "layers.0.end_offset": more,
        "layers.1.byte_count": plus(-1), "layers.1.stream_bytes.0": plus(-1)}))
    yield ("model-bytes", "stream_bytes[0] has one byte of the TILE blocks", *sizes, change_rows(plain, {
        "layers.1.stream_bytes.0": more, "layers.1.stream_bytes.12": plus(-1)}))
    yield ("layer-takes-anchor", "summaries that give an anchor of layer 2 to layer 1", *anchors, change_rows(plain, {
        "layers.0.anchor_count": more, "layers.0.gaussian_count": more}))
    yield ("tile-count-more", "a TILE block and its page say an anchor more than the summary", *anchors,
           change_rows(plain, entry_with(TILE_KIND, 2, count=more)))


_FULL = 2048
"""Pages that reach 2^64 - 2048 with numbers of 53 bits."""


def _wrap_faults() -> Iterator[Fault]:
    """2^64 more than there are: 2^53 - 1 in each of 2048 pages, what they had and 2048 more in the last."""
    base = many_pages_file(_FULL + 2)
    for name, field, refusal in (
        ("bytes", "block_bytes", "layer-directory-bytes"), ("anchors", "anchors", "layer-directory-anchors"),
    ):
        def change(pages: Pages, field: str = field) -> None:
            last = vars(pages.root.pages[-1].rows[0])
            for page in pages.root.pages[:_FULL]:
                row = vars(page.rows[0])
                last[field] += row[field] + 1
                row[field] = _MOST

        yield (f"page-{name}-wrap", f"{field} that sum to what they should modulo 2^64", "R-5.4-14 R-5.4-17", refusal,
               change_pages(base, root=change))
