"""Files that break two rules: SPEC §12.2 says which refusal a decoder gives."""

from __future__ import annotations

from collections.abc import Iterator

from conformance.scenes.cases import Case
from conformance.surgery.files import stored_frame
from conformance.surgery.parts import (
    TILE_KIND,
    PageChange,
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
from conformance.writer.pages import Pages

_LAYER, _TABLES, _CODEBOOKS = 1, 2, 3
_CRC, _ROW_CRC = "tile_crc32", "row_crc32"


def precedence_cases(base: bytes, paged: bytes) -> Iterator[Case]:
    """Two faults each; the rule named first is the one that decides.

    Args:
        base: a file of one page.
        paged: one of four pages and two layers, with row pages of pages 0 and 2, and of pages 0 and 3.
    """
    yield from _front_cases(base)
    yield from _root_cases(paged)
    yield from _page_cases(paged)
    yield from _block_cases(base)


def _case(name: str, purpose: str, rule: str, refusal: str, data: bytes, stage: str = "container") -> Case:
    id_ = f"invalid/precedence-{name}"
    return Case(id_, purpose, data, (rule, "R-12.2-1"), refusals=(refusal,), stage=stage)


def _front_cases(base: bytes) -> Iterator[Case]:
    header_end = taken_apart(base).header["header_length"]
    reserved = broken(base, header_with(version_reserved=1))
    yield _case("crc", "a wrong header CRC before a reserved byte that is set", "R-5.2-4", "header-crc-mismatch",
                flipped(reserved, header_end - 1))
    yield _case("fields", "the profile before the slots", "R-5.2-7", "bad-profile",
                broken(base, header_with(profile=9, slots=0)))
    yield _case("layers", "byte sums of layer 1 before the counts of layer 2", "R-5.3-3", "layer-bytes",
                broken(base, _both_layers))
    yield _case("trailing", "a byte too many before a damaged ROOT", "R-5.3-7", "trailing-bytes",
                flipped(base, header_end) + b"\0")
    yield _case("limit", "the reader's limit on tiles before the layer summaries", "R-5.2-19", "limit-tiles",
                broken(base, header_with(tile_count=(1 << 24) + 1)))


def _both_layers(parts: Parts) -> None:
    parts.layers[0]["byte_count"] += 1
    parts.layers[1]["gaussian_count"] += 1


def _root_cases(base: bytes) -> Iterator[Case]:
    def root(change: PageChange) -> bytes:
        return repaged(base, root=change)

    rows: tuple[tuple[str, str, str, str, bytes], ...] = (
        ("directory-crc", "the CRC of ROOT before a kind in it", "R-5.4-2", "directory-crc-mismatch",
         _stale_root(base)),
        ("root-whole", "a byte after ROOT before a kind in it", "R-5.7-2", "payload-long",
         rerooted(base, lambda bytes_: bytes_[:1] + b"\0" + bytes_[2:] + b"\0")),
        ("entries", "the flags of the last entry before the order of the first", "R-5.4-5", "entry-flags",
         root(_bad_entries)),
        ("entries-pages", "the count of METADATA before where a page begins", "R-5.4-10", "entry-count",
         root(_bad_gap)),
        ("page-bases", "where the last page begins before the bytes of the first", "R-5.4-11", "tile-order",
         root(_bad_base)),
        ("page-lengths", "the bytes of the last page before the sums of the first", "R-5.4-12", "page-length",
         root(_bad_lengths)),
        ("sums", "the anchors of layer 1 before the bytes of layer 2", "R-5.4-14", "layer-directory-anchors",
         root(_anchor_and_byte)),
        ("sums-length", "anchors of layer 2 before the length of all pages", "R-5.4-14", "layer-directory-anchors",
         root(_anchor_and_length)),
        ("length-unknown", "the length of all pages before a critical block of an unknown kind", "R-5.4-15",
         "directory-length",
         repaged(_unknown(base), root=lambda pages: _more(vars(pages.root.pages[0]), "tile_bytes"))),
        ("unknown", "a critical block of an unknown kind before the CRC of the first page", "R-5.4-16",
         "unknown-critical-block", repaged(_unknown(base), root=lambda pages: _more(vars(pages.root.pages[0]), _CRC))),
    )
    for row in rows:
        yield _case(*row)


def _more(row: dict[str, int], field: str) -> None:
    row[field] += 1


def _stale_root(base: bytes) -> bytes:
    parts = taken_apart(base)
    parts.entries[0]["kind"] = 0
    return parts.raw()


def _bad_entries(pages: Pages) -> None:
    pages.root.models[1][-1].flags = 3
    pages.root.models[0].reverse()


def _bad_gap(pages: Pages) -> None:
    pages.root.models[0][-1].count = 1
    pages.root.pages[1].gap = 0


def _bad_base(pages: Pages) -> None:
    pages.root.pages[3].gap = 0
    pages.root.pages[0].tile_bytes = 0


def _bad_lengths(pages: Pages) -> None:
    pages.root.pages[3].tile_bytes = 0
    pages.root.pages[0].rows[0].block_bytes = 0


def _anchor_and_byte(pages: Pages) -> None:
    pages.root.pages[2].rows[0].anchors += 1
    pages.root.pages[0].rows[1].block_bytes += 1


def _anchor_and_length(pages: Pages) -> None:
    pages.root.pages[3].rows[1].anchors += 1
    pages.root.pages[0].tile_bytes += 1


def _unknown(base: bytes) -> bytes:
    return remade(base, block_added(kind=17, flags=1, layer=2))


def _page_cases(base: bytes) -> Iterator[Case]:
    rows: tuple[tuple[str, str, str, str, bytes], ...] = (
        ("page-crc", "the CRC of a tile page before its numbers", "R-5.5-1", "page-crc-mismatch",
         repaged(base, _deep, lambda pages: _more(vars(pages.root.pages[1]), _CRC))),
        ("tiles", "the depth of the last tile of a page before the shift of the first", "R-5.5-3", "tile-depth",
         repaged(base, _bad_tiles)),
        ("tile-pages", "the local bits of page 1 before the CRC of page 2", "R-5.5-5", "tile-local-bits",
         repaged(base, _low_shift, lambda pages: _more(vars(pages.root.pages[2]), _CRC))),
        ("tile-prefix", "the prefix of the last tile of a page before where the first begins", "R-5.5-6", "tile-prefix",
         repaged(base, _bad_prefix)),
        ("tile-page-order", "where page 0 ends before the CRC of page 1", "R-5.5-7", "tile-order",
         repaged(base, _wide, lambda pages: _more(vars(pages.root.pages[1]), _CRC))),
        ("tiles-rows", "the depth of the last tile before the CRC of the first row page", "R-5.5-3", "tile-depth",
         repaged(base, _last_deep, lambda pages: _more(vars(pages.root.pages[0].rows[0]), _ROW_CRC))),
        ("row-pages", "the sums of the last row page of layer 1 before the CRC of the first of layer 2", "R-5.5-10",
         "page-sums", repaged(base, _row_more(1, 2), lambda pages: _more(vars(pages.root.pages[0].rows[1]), _ROW_CRC))),
        ("row-limits", "a count beyond its limit before lengths of another sum", "R-5.5-9", "limit-tile-anchors",
         repaged(base, _row_crowded)),
        ("rows-blocks", "the sums of a row page of layer 2 before the CRC of LAYER in layer 1", "R-5.5-10", "page-sums",
         repaged(broken(base, lambda p: _more(p.entry(_LAYER), "crc32")), _row_more(2, 3))),
    )
    for row in rows:
        yield _case(*row)


def _deep(pages: Pages) -> None:
    pages.tiles[1].depths[0] = 99


def _last_deep(pages: Pages) -> None:
    pages.tiles[3].depths[0] = 22


def _bad_tiles(pages: Pages) -> None:
    pages.tiles[2].shifts[0], pages.tiles[2].depths[1] = 99, 99


def _low_shift(pages: Pages) -> None:
    pages.tiles[1].shifts[1] = 0


def _bad_prefix(pages: Pages) -> None:
    pages.tiles[1].gaps[:] = [1, 1 << 40]


def _wide(pages: Pages) -> None:
    pages.tiles[0].depths[1], pages.tiles[0].gaps[1] = 1, 2


def _row_more(layer: int, page: int) -> PageChange:
    def change(pages: Pages) -> None:
        rows = pages.rows[layer - 1][page]
        assert rows is not None
        rows.lengths[0] += 1

    return change


def _row_crowded(pages: Pages) -> None:
    rows = pages.rows[0][2]
    assert rows is not None
    rows.lengths[0] += 1
    rows.counts[1] = (1 << 16) + 1


def _block_cases(base: bytes) -> Iterator[Case]:
    bad_layer = remade(base, lambda p: p.put(_LAYER, 1, lambda block: block + b"\0"))
    yield _case("block-crc", "the CRC of TABLES in layer 2 before the content of LAYER in layer 1", "R-5.6-1",
                "crc-mismatch", broken(bad_layer, lambda p: _more(p.entry(_TABLES, 2), "crc32")), "models")
    yield _case("models", "the content of LAYER in layer 2 before the CRC of a TILE block in layer 1", "R-5.7-2",
                "payload-long", broken(remade(base, lambda p: p.put(_LAYER, 2, lambda block: block + b"\0")),
                                       lambda p: _more(p.entry(TILE_KIND, 1), "crc32")), "models")
    yield _case("layer-by-layer", "TABLES of layer 1 before LAYER of layer 2", "R-5.8-4", "bad-zstd",
                remade(base, _bad_tables_and_layer), "models")
    yield _case("tables-codebooks", "TABLES of layer 2 before CODEBOOKS of layer 1", "R-5.7-2", "payload-long",
                remade(base, _bad_tables_and_books), "models")


def _bad_tables_and_layer(parts: Parts) -> None:
    parts.put(_TABLES, 1, lambda frame: frame + b"\0")
    parts.put(_LAYER, 2, lambda _: b"\2")


def _bad_tables_and_books(parts: Parts) -> None:
    parts.put(_TABLES, 2, lambda _: stored_frame(b"\0\0"))
    parts.put(_CODEBOOKS, 1, lambda _: b"\0")
