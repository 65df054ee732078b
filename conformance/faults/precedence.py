"""Files that break two rules: SPEC §12.2 says which refusal a decoder gives."""

from __future__ import annotations

from collections.abc import Iterator

from conformance.scenes.cases import Case, Fault, refuse
from conformance.surgery.edit import Changes, append, more, renumber, replace_bytes, splice
from conformance.surgery.files import change_block, change_numbers
from conformance.surgery.parts import (
    TILE_KIND,
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

_LAYER, _TABLES, _CODEBOOKS = 1, 2, 3


def precedence_cases(base: bytes, anchors: bytes, paged: bytes) -> Iterator[Case]:
    """Two faults each; the rule named first is the one that decides.

    Args:
        base: a file of one page.
        paged: one of four pages and two layers, with row pages of pages 0 and 2, and of pages 0 and 3.
    """
    for stage, faults in (
        ("container", _front_faults(base)), ("container", _root_faults(paged)), ("container", _page_faults(paged)),
        ("models", _block_faults(base, anchors)),
    ):
        for name, purpose, rule, refusal, data in faults:
            yield refuse(f"precedence-{name}", purpose, f"{rule} R-12.2-1", refusal, data, stage)


def _front_faults(base: bytes) -> Iterator[Fault]:
    header_end = take_apart(base).header["header_length"]
    yield ("crc", "a wrong header CRC before a reserved byte that is set", "R-5.2-4", "header-crc-mismatch",
           flip_bits(change_rows(base, header_with(render_model=3)), header_end - 1))
    yield ("fields", "the profile before the slots", "R-5.2-7", "bad-profile",
           change_rows(base, header_with(profile=9, slots=0)))
    yield ("layers", "byte sums of layer 1 before the counts of layer 2", "R-5.3-3", "layer-bytes",
           change_rows(base, {"layers.0.byte_count": more, "layers.1.gaussian_count": more}))
    yield ("trailing", "a byte too many before a damaged ROOT", "R-5.3-7", "trailing-bytes",
           flip_bits(base, header_end) + b"\0")
    yield ("limit", "the reader's limit on tiles before the layer summaries", "R-5.2-19", "limit-tiles",
           change_rows(base, header_with(tile_count=(1 << 24) + 1)))


def _root_faults(base: bytes) -> Iterator[Fault]:
    parts = take_apart(base)
    parts.entries[0]["kind"] = 0
    yield ("directory-crc", "the CRC of ROOT before a kind in it", "R-5.4-2", "directory-crc-mismatch", parts.raw())
    yield ("root-whole", "a byte after ROOT before a kind in it", "R-5.7-2", "payload-long",
           change_root(base, lambda root: append()(splice(1, b"\0")(root))))
    unknown = remake(base, block_added(kind=17, flags=1, layer=2))
    rows: tuple[tuple[str, str, str, str, bytes, Changes], ...] = (
        ("entries", "the flags of the last entry before the order of the first", "R-5.4-5", "entry-flags", base,
         {"root.models.1.-1.flags": 3, "root.models.0": lambda rows: rows[::-1]}),
        ("entries-pages", "the count of METADATA before where a page begins", "R-5.4-10", "entry-count", base,
         {"root.models.0.-1.count": 1, "root.pages.1.gap": 0}),
        ("page-bases", "where the last page begins before the bytes of the first", "R-5.4-11", "tile-order", base,
         {"root.pages.3.gap": 0, "root.pages.0.tile_bytes": 0}),
        ("page-lengths", "the bytes of the last page before the sums of the first", "R-5.4-12", "page-length", base,
         {"root.pages.3.tile_bytes": 0, "root.pages.0.rows.0.block_bytes": 0}),
        ("sums", "the anchors of layer 1 before the bytes of layer 2", "R-5.4-14", "layer-directory-anchors", base,
         {"root.pages.2.rows.0.anchors": more, "root.pages.0.rows.1.block_bytes": more}),
        ("sums-length", "anchors of layer 2 before the length of all pages", "R-5.4-14", "layer-directory-anchors",
         base, {"root.pages.3.rows.1.anchors": more, "root.pages.0.tile_bytes": more}),
        ("length-unknown", "the length of all pages before a critical block of an unknown kind", "R-5.4-15",
         "directory-length", unknown, {"root.pages.0.tile_bytes": more}),
        ("unknown", "a critical block of an unknown kind before the CRC of the first page", "R-5.4-16",
         "unknown-critical-block", unknown, {"root.pages.0.tile_crc32": more}),
    )
    for name, purpose, rule, refusal, data, changes in rows:
        yield name, purpose, rule, refusal, change_pages(data, root=changes)


def _page_faults(base: bytes) -> Iterator[Fault]:
    rows: tuple[tuple[str, str, str, str, Changes, Changes], ...] = (
        ("page-crc", "the CRC of a tile page before its numbers", "R-5.5-1", "page-crc-mismatch",
         {"tiles.1.depths.0": 99}, {"root.pages.1.tile_crc32": more}),
        ("tiles", "the depth of the last tile of a page before the shift of the first", "R-5.5-3", "tile-depth",
         {"tiles.2.shifts.0": 99, "tiles.2.depths.1": 99}, {}),
        ("tile-pages", "the local bits of page 1 before the CRC of page 2", "R-5.5-5", "tile-local-bits",
         {"tiles.1.shifts.1": 0}, {"root.pages.2.tile_crc32": more}),
        ("tile-prefix", "the prefix of the last tile of a page before where the first begins", "R-5.5-6", "tile-prefix",
         {"tiles.1.gaps": [1, 1 << 40]}, {}),
        ("tile-page-order", "where page 0 ends before the CRC of page 1", "R-5.5-7", "tile-order",
         {"tiles.0.depths.1": 1, "tiles.0.gaps.1": 2}, {"root.pages.1.tile_crc32": more}),
        ("tiles-rows", "the depth of the last tile before the CRC of the first row page", "R-5.5-3", "tile-depth",
         {"tiles.3.depths.0": 22}, {"root.pages.0.rows.0.row_crc32": more}),
        ("row-pages", "the sums of the last row page of layer 1 before the CRC of the first of layer 2", "R-5.5-10",
         "page-sums", {"rows.0.2.lengths.0": more}, {"root.pages.0.rows.1.row_crc32": more}),
        ("row-limits", "a count beyond its limit before lengths of another sum", "R-5.5-9", "limit-tile-anchors",
         {"rows.0.2.lengths.0": more, "rows.0.2.counts.1": (1 << 16) + 1}, {}),
    )
    for name, purpose, rule, refusal, contents, root in rows:
        yield name, purpose, rule, refusal, change_pages(base, contents, root)
    yield ("rows-blocks", "the sums of a row page of layer 2 before the CRC of LAYER in layer 1", "R-5.5-10",
           "page-sums", change_pages(change_rows(base, entry_with(_LAYER, crc32=more)), {"rows.1.3.lengths.0": more}))


def _block_faults(base: bytes, anchors: bytes) -> Iterator[Fault]:
    first, second = (change_block(base, _LAYER, layer, append()) for layer in (1, 2))
    yield ("block-crc", "the CRC of TABLES in layer 2 before the content of LAYER in layer 1", "R-5.6-1",
           "crc-mismatch", change_rows(first, entry_with(_TABLES, 2, crc32=more)))
    yield ("models", "the content of LAYER in layer 2 before the CRC of a TILE block in layer 1", "R-8.2-1",
           "rans-length", change_rows(second, entry_with(TILE_KIND, crc32=more)))
    yield ("layer-by-layer", "TABLES of layer 1 before LAYER of layer 2", "R-8.2-1", "rans-length",
           change_block(change_block(base, _TABLES, 1, append()), _LAYER, 2, replace_bytes(bytes(4))))
    steps = change_numbers(base, _LAYER, renumber(("steps", 21)))
    yield ("tables-rows", "TABLES of layer 1 before the steps of LAYER", "R-8.2-1", "rans-length",
           change_block(steps, _TABLES, 1, append()))
    passes = change_numbers(base, _LAYER, renumber(("passes_log2", 4)))
    yield ("layer-context", "the seal of LAYER before its passes", "R-8.2-2", "rans-seal",
           change_numbers(passes, _LAYER, lambda numbers: [*numbers, (("more", None), 1)]))
    yield ("tables-codebooks", "TABLES of layer 2 before CODEBOOKS of layer 1", "R-8.2-1", "rans-last-word",
           change_block(change_block(anchors, _TABLES, 2, replace_bytes(bytes(4))), _CODEBOOKS, 1,
                        replace_bytes(b"\0")))
