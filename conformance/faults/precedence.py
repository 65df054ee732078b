"""Files that break two rules: SPEC §12.2 says which refusal a decoder gives."""

from __future__ import annotations

from collections.abc import Iterator

from conformance.scenes.cases import Case
from conformance.spec.spec_text import size_of
from conformance.surgery.files import stored_frame
from conformance.surgery.parts import (
    TILE_KIND,
    Change,
    Parts,
    Row,
    block_added,
    broken,
    flipped,
    header_with,
    remade,
    taken_apart,
)

_LAYER, _TABLES, _CODEBOOKS = 1, 2, 3


def precedence_cases(base: bytes) -> Iterator[Case]:
    """Two faults each; the rule named first is the one that decides."""
    yield from _front_cases(base)
    yield from _table_cases(base)
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
    yield _case("trailing", "a byte too many before a damaged directory", "R-5.3-7", "trailing-bytes",
                flipped(base, header_end + size_of("TILE_RECORD")) + b"\0")
    yield _case("limit", "the reader's limit on tiles before the layer summaries", "R-5.2-19", "limit-tiles",
                broken(base, header_with(tile_count=(1 << 20) + 1)))


def _both_layers(parts: Parts) -> None:
    parts.layers[0]["byte_count"] += 1
    parts.layers[1]["gaussian_count"] += 1


def _table_cases(base: bytes) -> Iterator[Case]:
    yield _case("directory-crc", "the CRC of the directory before the order of tiles", "R-5.4-2",
                "directory-crc-mismatch", _swapped_tiles_stale_crc(base))
    rows: tuple[tuple[str, str, str, str, Change], ...] = (
        ("tiles", "a reserved byte of the last tile before the depth of the first", "R-5.4-3", "bad-reserved",
         _bad_tiles),
        ("entries", "the flags of the last entry before the layer of the first", "R-5.5-3", "entry-flags",
         _bad_entries),
        ("sums", "the anchors of layer 1 before the bytes of layer 2", "R-5.5-12", "layer-directory-anchors",
         _anchor_and_byte),
    )
    for name, purpose, rule, refusal, change in rows:
        yield _case(name, purpose, rule, refusal, broken(base, change))
    yield _case("unknown", "the anchors of layer 2 before a critical block of an unknown kind", "R-5.5-12",
                "layer-directory-anchors", broken(
                    remade(base, block_added(kind=17, flags=1, layer=2)),
                    lambda p: _more(p.entry(TILE_KIND, 2), "count")))


def _more(row: Row, field: str) -> None:
    row[field] += 1


def _bad_tiles(parts: Parts) -> None:
    parts.tiles[2]["reserved"] = 1
    parts.tiles[0]["depth"] = 99


def _bad_entries(parts: Parts) -> None:
    parts.entries[-1]["flags"] = 3
    parts.entries[0]["layer"] = 9


def _anchor_and_byte(parts: Parts) -> None:
    _more(parts.entry(TILE_KIND, 1), "count")
    sizes = parts.layers[1]["stream_bytes"]
    parts.layers[1]["stream_bytes"] = (sizes[0] + 1, *sizes[1:12], sizes[12] - 1)


def _swapped_tiles_stale_crc(base: bytes) -> bytes:
    parts = taken_apart(base)
    parts.tiles.reverse()
    return parts.raw()


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
