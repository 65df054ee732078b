"""Files that break exactly one rule of the container (SPEC §5.1-§5.6), checksums right unless they are the fault.

Small files of :mod:`conformance.scenes.container_scenes` are taken apart by the tables of SPEC.md, changed, and put
together.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

from conformance.faults.precedence import precedence_cases
from conformance.faults.zstd_faults import zstd_faults
from conformance.scenes.cases import Case, refused
from conformance.scenes.container_scenes import anchor_file, plain_file, root_file
from conformance.spec.spec_text import size_of
from conformance.surgery.parts import (
    NO_TILE,
    TILE_KIND,
    Change,
    Parts,
    Row,
    block_added,
    broken,
    field_at,
    flipped,
    header_with,
    remade,
    taken_apart,
)

_LAYER, _TABLES, _METADATA = 1, 2, 64
_TOP = (1 << 64) - 1
_RESERVED = frozenset({"bad-reserved", "bad-profile", "bad-coordinate-frame", "bad-colour-space", "entry-flags"})


def container_faults(_files: Mapping[str, bytes]) -> Iterator[Case]:
    """One case for each way of breaking a rule of §5.1 to §5.6 or §5.8 that a careless reader would not see.

    The valid vectors are not needed: the bases are smaller than most of them.
    """
    yield from _signature_faults()
    yield from _header_faults()
    yield from _place_faults()
    yield from _layer_faults()
    yield from _tile_faults()
    yield from _entry_faults()
    yield from _directory_faults()
    yield from _block_faults()
    yield from zstd_faults(plain_file())
    yield from precedence_cases(plain_file())


def _case(id_: str, purpose: str, rule: str, refusal: str, data: bytes) -> Case:
    case = refused(id_, purpose, rule, refusal, data, "container")
    # Of what is reserved: no reader ignores it.
    return replace(case, rules=(rule, "R-11-2")) if refusal in _RESERVED else case


# ------------------------------------------------------------------------------------------------ §5.1


def _signature_faults() -> Iterator[Case]:
    base = plain_file()
    sign, rest = base[:9], base[9:]
    damaged = {
        "signature-crlf": ("LF became CR LF everywhere in the signature", b"\x89SCAR\r\r\n\x1a\r\n"),
        "signature-cr": ("CR LF became CR", sign.replace(b"\r\n", b"\r")),
        "signature-7-bit": ("the high bit of the first byte was stripped", bytes([sign[0] & 0x7F]) + sign[1:]),
        "signature-utf-8": ("the first byte became two, as Latin-1 text turned into UTF-8", b"\xc2" + sign),
        "signature-late": ("SCAR in the last four of the first eight bytes", b"\0\0\0" + sign),
    }
    for name, (purpose, start) in damaged.items():
        yield _case(name, purpose, "R-5.1-1", "damaged-signature", start + rest)
    yield _case("signature-1a-cut", "the file ends before the byte 1A and has another byte there",
                "R-5.1-1", "damaged-signature", sign[:7] + b"\n")
    bad = {
        "signature-later": ("SCAR one byte later than it is looked for", b"\0\0\0\0" + sign + rest),
        "signature-lower": ("small letters", sign.replace(b"SCAR", b"scar") + rest),
        "signature-zeros": ("as long as a header, all zeros", bytes(240)),
        "signature-short": ("three bytes, none of which are the signature's", b"SCA"),
    }
    for name, (purpose, data) in bad.items():
        yield _case(name, purpose, "R-5.1-1", "bad-signature", data)
    for name, major, minor in (("0-0", 0, 0), ("1-1", 1, 1), ("255-1", 255, 1)):
        data = sign + bytes([major, minor]) + base[11:]
        yield Case(
            f"invalid/version-{name}", f"version {major}.{minor}; the header's CRC does not count", data,
            ("R-5.1-2", "R-11-1"), refusals=("unsupported-version",), stage="container",
        )
    yield _case("version-only", "eleven bytes, version 0.2: refused before the missing rest",
                "R-5.1-2", "unsupported-version", sign + b"\0\2")


# ------------------------------------------------------------------------------------------------ §5.2


def _header_faults() -> Iterator[Case]:
    """Single fields of the header, in the order of the rules."""
    plain, anchors = plain_file(), anchor_file()
    rows: tuple[tuple[str, str, str, str, bytes, dict[str, object]], ...] = (
        ("version-reserved", "the byte after the version is 1", "R-5.2-5", "bad-reserved", plain,
         {"version_reserved": 1}),
        ("reserved-high", "the highest bit of the reserved byte", "R-5.2-14", "bad-reserved", plain, {"reserved": 128}),
        ("file-length-2-53", "2^53 bytes declared", "R-5.2-6", "bad-file-length", plain, {"file_length": 1 << 53}),
        ("file-length-top", "2^64 - 1 bytes declared", "R-5.2-6", "bad-file-length", plain, {"file_length": _TOP}),
        ("profile-two", "profile 2", "R-5.2-7", "bad-profile", plain, {"profile": 2}),
        ("degree-four", "degree 4", "R-5.2-8", "bad-sh-degree", plain, {"sh_degree": 4}),
        ("degree-of-anchors", "degree 1 in the anchor profile", "R-5.2-8", "bad-sh-degree", anchors, {"sh_degree": 1}),
        ("layers-fewer", "one layer declared, header_length for two", "R-5.2-9", "bad-layer-count", plain,
         {"layer_count": 1}),
        ("layers-more", "three layers declared, header_length for two", "R-5.2-9", "bad-layer-count", plain,
         {"layer_count": 3}),
        ("slots-none", "no slots", "R-5.2-10", "bad-slots", anchors, {"slots": 0}),
        ("slots-33", "33 slots", "R-5.2-10", "bad-slots", anchors, {"slots": 33}),
        ("lattice-none", "0 lattice bits", "R-5.2-11", "bad-lattice-bits", plain, {"lattice_bits": 0}),
        ("lattice-33", "33 lattice bits", "R-5.2-11", "bad-lattice-bits", plain, {"lattice_bits": 33}),
        ("frame-three", "coordinate frame 3", "R-5.2-12", "bad-coordinate-frame", plain, {"coordinate_frame": 3}),
        ("colours-three", "colour space 3", "R-5.2-13", "bad-colour-space", plain, {"colour_space": 3}),
        ("origin-nan", "x of the origin is not a number", "R-5.2-15", "bad-origin", plain,
         {"origin": (math.nan, 0, 0)}),
        ("origin-infinite", "y of the origin is infinite", "R-5.2-15", "bad-origin", plain,
         {"origin": (0, math.inf, 0)}),
        ("origin-minus", "z of the origin is minus infinity", "R-5.2-15", "bad-origin", plain,
         {"origin": (0, 0, -math.inf)}),
        ("source-count-2-53", "source_count is 2^53", "R-5.2-18", "bad-source-count", plain, {"source_count": 1 << 53}),
    )
    for name, purpose, rule, refusal, base, change in rows:
        yield _case(name, purpose, rule, refusal, broken(base, header_with(**change)))
    yield from _voxel_faults(plain)


def _voxel_faults(base: bytes) -> Iterator[Case]:
    voxels = {"zero": 0.0, "minus-zero": -0.0, "negative": -1.0, "nan": math.nan, "infinite": math.inf}
    for name, voxel in voxels.items():
        data = broken(base, header_with(voxel=voxel))
        yield _case(f"voxel-{name}", f"voxel is {voxel}", "R-5.2-16", "bad-voxel", data)
    yield _case("voxel-reach", "voxel * 2^33 is infinite", "R-5.2-17", "bad-voxel",
                broken(base, header_with(voxel=1e300, origin=(0.0, 0.0, 0.0))))
    # 2^1023 + 2^1023 overflows; each alone is finite.
    yield _case("voxel-origin-reach", "|z of the origin| + voxel * 2^33 is infinite, neither of them alone",
                "R-5.2-17", "bad-voxel",
                broken(base, header_with(voxel=2.0**990, origin=(0.0, 0.0, -(2.0**1023)))))


def _place_faults() -> Iterator[Case]:
    """Lengths and checksums of the header."""
    base = plain_file()
    for name, length in (("104", 104), ("odd", taken_apart(base).header["header_length"] + 1), ("top", (1 << 32) - 1)):
        yield _case(f"header-length-{name}", f"header_length is {length}", "R-5.2-2", "bad-header-length",
                    broken(base, header_with(header_length=length)))
    yield _case("no-layers", "a file without layers, consistent otherwise", "R-5.2-2", "bad-header-length",
                remade(base, _no_layers))
    yield _case("seventeen-layers", "17 layers, consistent otherwise", "R-5.2-2", "bad-header-length",
                remade(base, lambda p: p.layers.extend(dict(p.layers[-1]) for _ in range(15))))
    length = taken_apart(base).header["header_length"]
    yield _case("header-crc", "the CRC itself is wrong", "R-5.2-4", "header-crc-mismatch",
                flipped(base, length - size_of("HEADER_CHECKSUM")))
    summary = field_at("LAYER_SUMMARY", "stream_bytes", size_of("FILE_HEADER") + size_of("LAYER_SUMMARY"), 12)
    yield _case("summary-bit", "one bit of the last layer summary is flipped", "R-5.2-4", "header-crc-mismatch",
                flipped(base, summary))


def _no_layers(parts: Parts) -> None:
    parts.layers, parts.tiles, parts.entries, parts.blocks = [], [], [], []


# ------------------------------------------------------------------------------------------------ §5.3


def _layer_faults() -> Iterator[Case]:
    yield from _count_faults()
    yield from _byte_faults()
    base = plain_file()
    yield _case("trailing-4-kib", "zeros up to a whole sector", "R-5.3-7", "trailing-bytes",
                base + bytes(4096 - len(base)))


def _count_faults() -> Iterator[Case]:
    plain, anchors = plain_file(), anchor_file()
    yield _case("anchors-fall", "layer 2 has fewer anchors than layer 1", "R-5.3-1", "layer-counts",
                broken(plain, lambda p: _counts(p, 1, p.layers[0]["anchor_count"] - 1)))
    yield _case("anchors-fall-alone", "layer 2 has fewer anchors than layer 1, but not fewer Gaussians", "R-5.3-1",
                "layer-counts", broken(anchors, lambda p: p.layers[0].update(
                    anchor_count=p.layers[1]["anchor_count"] + 1)))
    yield _case("gaussians-fall", "layer 2 has fewer Gaussians than layer 1, but more anchors", "R-5.3-1",
                "layer-counts", broken(anchors, lambda p: _gaussians(p, 1, p.layers[0]["gaussian_count"] - 1)))
    yield _case("gaussians-more", "more Gaussians than anchors in the explicit profile", "R-5.3-2", "layer-counts",
                broken(plain, lambda p: _gaussians(p, 1, p.layers[1]["anchor_count"] + 1)))
    yield _case("gaussians-beyond-slots", "one Gaussian more than anchors times slots", "R-5.3-2", "layer-counts",
                broken(anchors, lambda p: _gaussians(p, 1, p.header["slots"] * p.layers[1]["anchor_count"] + 1)))
    for name in ("anchor_count", "gaussian_count"):
        count = taken_apart(plain).header[name]
        yield _case(f"header-{name.replace('_', '-')}", f"{name} of the header is not that of the last layer",
                    "R-5.3-5", "layer-counts", broken(plain, header_with(**{name: count + 1})))


def _gaussians(parts: Parts, layer: int, count: int) -> None:
    parts.layers[layer]["gaussian_count"] = parts.header["gaussian_count"] = count


def _counts(parts: Parts, layer: int, count: int) -> None:
    parts.layers[layer]["anchor_count"] = parts.header["anchor_count"] = count
    _gaussians(parts, layer, count)


def _byte_faults() -> Iterator[Case]:
    base = plain_file()
    yield _case("layer-bytes-less", "stream_bytes sum to one less than byte_count", "R-5.3-3", "layer-bytes",
                broken(base, lambda p: _streams(p.layers[1], {12: -1})))
    yield _case("layer-bytes-wrap", "stream_bytes sum to byte_count modulo 2^64", "R-5.3-3", "layer-bytes",
                broken(base, lambda p: _streams(p.layers[0], {1: 1 << 63, 9: 1 << 63})))
    yield _case("layer-end", "end_offset of layer 1 is one byte late", "R-5.3-4", "layer-offset",
                broken(base, lambda p: p.layers[0].update(end_offset=p.layers[0]["end_offset"] + 1)))
    yield _case("layer-end-wrap", "bytes of layer 1 that bring its end back to before its start, modulo 2^64",
                "R-5.3-4", "layer-offset", broken(base, _wrapped_end))
    yield _case("file-length-more", "file_length is one more than the end of the last layer", "R-5.3-6",
                "bad-file-length", broken(base, header_with(file_length=len(base) + 1)) + b"\0")
    yield _case("file-length-less", "file_length is one less than the end of the last layer", "R-5.3-6",
                "bad-file-length", broken(base, header_with(file_length=len(base) - 1)))


def _streams(layer: Row, more: dict[int, int]) -> None:
    layer["stream_bytes"] = tuple(size + more.get(kind, 0) for kind, size in enumerate(layer["stream_bytes"]))


def _wrapped_end(parts: Parts) -> None:
    """Layer 1 ends 16 bytes before its start, layer 2 where it did."""
    first, second = parts.layers
    back = first["byte_count"] + 16
    for layer, more in ((first, (1 << 64) - back), (second, back)):
        layer["byte_count"] += more
        _streams(layer, {0: more})
    first["end_offset"] -= back


# ------------------------------------------------------------------------------------------------ §5.4


def _tile_faults() -> Iterator[Case]:
    base, root = plain_file(), root_file()
    yield _case("directory-bit", "one bit of the directory is flipped", "R-5.4-2", "directory-crc-mismatch",
                flipped(base, taken_apart(base).header["header_length"] + 12 * 3 + 32 + 28))
    yield _case("directory-crc", "the CRC of tile table and directory is wrong", "R-5.4-2", "directory-crc-mismatch",
                _wrong_directory_crc(base))
    rows: tuple[tuple[str, str, str, str, bytes, Change], ...] = (
        ("tile-reserved-low", "the low reserved byte of the last tile is 1", "R-5.4-3", "bad-reserved", base,
         lambda p: p.tiles[2].update(reserved=1)),
        ("tile-reserved-high", "the high reserved byte of the last tile is 1", "R-5.4-3", "bad-reserved", base,
         lambda p: p.tiles[2].update(reserved=256)),
        ("tile-depth-22", "depth 22, with local bits and prefix in range", "R-5.4-4", "tile-depth", base,
         lambda p: p.tiles[2].update(depth=22, shift=5, prefix=7 << 60)),
        ("tile-shift-32", "shift 32, with 0 local bits", "R-5.4-5", "tile-shift", root,
         lambda p: p.tiles[0].update(shift=32)),
        ("tile-local-22", "22 local bits", "R-5.4-6", "tile-local-bits", base,
         lambda p: p.tiles[2].update(shift=9)),
        ("tile-prefix-root", "a prefix that is not 0 at depth 0", "R-5.4-7", "tile-prefix", root,
         lambda p: p.tiles[0].update(prefix=1)),
        ("tile-prefix-large", "a prefix of 4 bits at depth 1", "R-5.4-7", "tile-prefix", base,
         lambda p: p.tiles[2].update(prefix=8)),
        ("tile-prefix-2-63", "a prefix of 64 bits at depth 21", "R-5.4-7", "tile-prefix", base,
         lambda p: p.tiles[2].update(depth=21, shift=0, prefix=1 << 63)),
        ("tile-twice", "two tiles of one cube", "R-5.4-8", "tile-order", base,
         lambda p: p.tiles[1].update(p.tiles[0])),
        ("tile-inside", "a cube, then one inside it", "R-5.4-8", "tile-order", base,
         lambda p: p.tiles[1].update(depth=2, prefix=8 * p.tiles[0]["prefix"] + 1)),
        ("tile-around", "a cube, then one around it", "R-5.4-8", "tile-order", base,
         lambda p: p.tiles[2].update(depth=1, prefix=p.tiles[1]["prefix"] // 8)),
        ("tile-around-first", "the first child of a cube, then the cube: both start at one point", "R-5.4-8",
         "tile-order", base, _first_child),
    )
    for name, purpose, rule, refusal, data, change in rows:
        yield _case(name, purpose, rule, refusal, broken(data, change))


def _wrong_directory_crc(base: bytes) -> bytes:
    parts = taken_apart(base)
    parts.header["directory_crc32"] ^= 1 << 31
    return parts.raw()


def _first_child(parts: Parts) -> None:
    parts.tiles[1].update(depth=2, shift=27, prefix=8 * 5)


# ------------------------------------------------------------------------------------------------ §5.5


def _entry_faults() -> Iterator[Case]:
    """Fields of one entry; the file is consistent in everything else."""
    base = plain_file()
    rows: tuple[tuple[str, str, str, str, Change], ...] = (
        ("entry-kind-zero", "a block of kind 0", "R-5.5-1", "entry-kind", lambda p: p.insert(0, kind=0)),
        ("entry-reserved", "the reserved byte of an entry is 1", "R-5.5-2", "bad-reserved",
         lambda p: p.entry(_METADATA).update(reserved=1)),
        ("flags-layer-none", "a LAYER block that is not critical", "R-5.5-3", "entry-flags",
         lambda p: p.entry(_LAYER).update(flags=0)),
        ("flags-tile-both", "a TILE block with both flags", "R-5.5-3", "entry-flags",
         lambda p: p.entry(TILE_KIND).update(flags=3)),
        ("flags-tile-copy", "a TILE block that is safe to copy", "R-5.5-3", "entry-flags",
         lambda p: p.entry(TILE_KIND).update(flags=2)),
        ("flags-metadata-none", "METADATA without a flag", "R-5.5-3", "entry-flags",
         lambda p: p.entry(_METADATA).update(flags=0)),
        ("flags-metadata-critical", "METADATA that is critical", "R-5.5-3", "entry-flags",
         lambda p: p.entry(_METADATA).update(flags=1)),
        ("flags-private-both", "a private block with both flags", "R-5.5-3", "entry-flags", block_added(flags=3)),
        ("flags-private-bit", "a reserved flag of a private block", "R-5.5-3", "entry-flags", block_added(flags=4)),
        ("flags-private-high", "the highest flag of a private block", "R-5.5-3", "entry-flags",
         block_added(flags=130)),
        ("flags-model-none", "a block of the reserved kind 15 that is not critical", "R-5.5-3", "entry-flags",
         lambda p: p.insert(4, kind=15, flags=0)),
        ("metadata-late", "METADATA in layer 2", "R-5.5-4", "entry-layer", _late_metadata),
        ("tile-index", "a TILE block of tile 3 of 3", "R-5.5-5", "entry-tile",
         lambda p: p.entry(TILE_KIND, 1, 2).update(tile=3)),
        ("tile-none", "a TILE block of no tile", "R-5.5-5", "entry-tile",
         lambda p: p.entry(TILE_KIND, 1, 2).update(tile=NO_TILE)),
        ("layer-of-tile", "a LAYER block of tile 0", "R-5.5-5", "entry-tile", lambda p: p.entry(_LAYER).update(tile=0)),
        ("metadata-of-tile", "METADATA of tile 0", "R-5.5-5", "entry-tile",
         lambda p: p.entry(_METADATA).update(tile=0)),
        ("private-of-tile", "a private block of tile 3 of 3", "R-5.5-5", "entry-tile", block_added(tile=3)),
        ("private-of-tile-top", "a private block of tile 0xFFFFFFFE", "R-5.5-5", "entry-tile",
         block_added(tile=NO_TILE - 1)),
        ("metadata-count", "the count of METADATA is 1", "R-5.5-11", "entry-count",
         lambda p: p.entry(_METADATA).update(count=1)),
        ("critical-model", "a critical block of the reserved kind 9", "R-5.5-13", "unknown-critical-block",
         lambda p: p.insert(4, kind=9, flags=1)),
        ("critical-reserved", "a critical block of the reserved kind 17", "R-5.5-13", "unknown-critical-block",
         lambda p: p.insert(7, kind=17, flags=1)),
        ("critical-annotation", "a critical annotation", "R-5.5-13", "unknown-critical-block",
         lambda p: p.insert(8, kind=65, flags=1)),
    )
    for name, purpose, rule, refusal, change in rows:
        yield _case(name, purpose, rule, refusal, remade(base, change))
    # Counted in the summary of the layer that it moves away from.
    yield _case("entry-layer-zero", "a block of layer 0", "R-5.5-4", "entry-layer",
                broken(remade(base, lambda p: p.insert(0)), lambda p: p.entries[0].update(layer=0)))
    yield _case("entry-layer-late", "a block of layer 3 of 2", "R-5.5-4", "entry-layer",
                broken(remade(base, block_added(layer=2)), lambda p: p.entries[-1].update(layer=3)))


def _late_metadata(parts: Parts) -> None:
    row = parts.row(_METADATA)
    payload = parts.blocks[row]
    parts.remove(row)
    parts.add(payload, kind=_METADATA, flags=2, layer=2)


def _directory_faults() -> Iterator[Case]:
    yield from _order_faults()
    yield from _extent_faults()
    yield from _sum_faults()


def _order_faults() -> Iterator[Case]:
    base = plain_file()
    tiles = taken_apart(base).row(TILE_KIND)
    rows: tuple[tuple[str, str, Change], ...] = (
        ("order-tiles", "TILE 1 before TILE 0", lambda p: p.swap(tiles, tiles + 1)),
        ("order-kinds", "TABLES before LAYER", lambda p: p.swap(0, 1)),
        ("order-layers", "a block of layer 1 after one of layer 2", lambda p: p.insert(len(p.entries) - 1)),
        ("order-no-tile", "a private block of no tile before one of a tile, as if 0xFFFFFFFF were -1", _no_tile_first),
        ("entry-twice", "two METADATA blocks", _twice(_METADATA)),
        ("tile-block-twice", "two TILE blocks of one tile and layer", _twice(TILE_KIND)),
    )
    for name, purpose, change in rows:
        yield _case(name, purpose, "R-5.5-6", "entry-order", remade(base, change))


def _no_tile_first(parts: Parts) -> None:
    parts.add()
    parts.add(tile=0)


def _twice(kind: int) -> Change:
    def change(parts: Parts) -> None:
        row = parts.row(kind)
        entry = parts.entries[row]
        # The second adds no anchors: the sums stay right.
        parts.insert(row + 1, parts.blocks[row], **{**entry, "count": 0})

    return change


def _extent_faults() -> Iterator[Case]:
    base = plain_file()
    entries = taken_apart(base).entries
    last = len(entries) - 1
    yield _case("entry-empty", "a block of no bytes", "R-5.5-7", "entry-length", remade(base, block_added(b"")))
    for name, length in (("top", _TOP), ("2-63", 1 << 63), ("beyond", len(base) + 1)):
        yield _case(f"entry-length-{name}", f"the last block has {length} bytes", "R-5.5-7", "entry-length",
                    broken(base, _with_entry(last, "length", length)))
    for name, purpose, row, more in (
        ("first", "the first block starts one byte before the end of the directory", 0, -1),
        ("back", "a block starts at the last byte of the block before", 3, -1),
        ("top", "the last block starts at byte 2^63 + its place", last, 1 << 63),
    ):
        yield _case(f"entry-offset-{name}", purpose, "R-5.5-9", "entry-offset",
                    broken(base, _with_entry(row, "offset", entries[row]["offset"] + more)))
    yield _case("entry-shared", "two entries have the bytes of one block", "R-5.5-9", "entry-offset",
                broken(base, _with_entry(3, "offset", entries[2]["offset"])))
    yield _case("entry-offset-beyond", "a block ends, and the next starts, past the end of the file", "R-5.5-9",
                "entry-offset", broken(base, _beyond_end))


def _with_entry(row: int, field: str, value: int) -> Change:
    return lambda parts: parts.entries[row].update({field: value})


def _beyond_end(parts: Parts) -> None:
    parts.entries[-2]["length"] = parts.header["file_length"]
    parts.entries[-1]["offset"] = parts.entries[-2]["offset"] + parts.header["file_length"]


def _sum_faults() -> Iterator[Case]:
    base = plain_file()
    yield _case("layer-takes-byte", "summaries that give a byte of layer 2 to layer 1", "R-5.5-12",
                "layer-directory-bytes", broken(base, _byte_to_first))
    yield _case("model-bytes", "stream_bytes[0] has one byte of the TILE blocks", "R-5.5-12", "layer-directory-bytes",
                broken(base, lambda p: _streams(p.layers[1], {0: 1, 12: -1})))
    yield _case("layer-takes-anchor", "summaries that give an anchor of layer 2 to layer 1", "R-5.5-12",
                "layer-directory-anchors", broken(base, _anchor_to_first))
    yield _case("tile-count-more", "a TILE block says one anchor more than the summary", "R-5.5-12",
                "layer-directory-anchors", broken(base, _one_more_anchor))


def _byte_to_first(parts: Parts) -> None:
    for layer, more in zip(parts.layers, (1, -1), strict=True):
        layer["byte_count"] += more
        _streams(layer, {0: more})
    parts.layers[0]["end_offset"] += 1


def _anchor_to_first(parts: Parts) -> None:
    for name in ("anchor_count", "gaussian_count"):
        parts.layers[0][name] += 1


def _one_more_anchor(parts: Parts) -> None:
    parts.entry(TILE_KIND, 2)["count"] += 1


# ------------------------------------------------------------------------------------------------ §5.6


def _block_faults() -> Iterator[Case]:
    base = plain_file()
    for name, kind, layer, stage in (("layer", _LAYER, 2, "models"), ("tables", _TABLES, 1, "models"),
                                     ("tile", TILE_KIND, 2, "tiles")):
        data = broken(base, _wrong_crc(kind, layer))
        purpose = f"the entry of a {name.upper()} block has a wrong CRC"
        yield refused(f"entry-crc-{name}", purpose, "R-5.6-1", "crc-mismatch", data, stage)


def _wrong_crc(kind: int, layer: int) -> Change:
    def change(parts: Parts) -> None:
        parts.entry(kind, layer)["crc32"] ^= 1

    return change
