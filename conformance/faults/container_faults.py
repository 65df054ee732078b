"""Files that break exactly one rule of header, layer summaries or blocks (SPEC §5.1-§5.3, §5.6), checksums right unless
they are the fault. Those of ROOT and pages are in :mod:`.root_faults` and :mod:`.page_faults`.

Small files of :mod:`conformance.scenes.container_scenes` are taken apart by the tables of SPEC.md, changed, and put
together.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

from conformance.faults.page_faults import page_faults
from conformance.faults.precedence import precedence_cases
from conformance.faults.root_faults import root_faults
from conformance.faults.zstd_faults import zstd_faults
from conformance.scenes.cases import Case, refused
from conformance.scenes.container_scenes import anchor_file, paged_file, plain_file
from conformance.spec.spec_text import size_of
from conformance.surgery.parts import (
    TILE_KIND,
    Change,
    Parts,
    Row,
    broken,
    field_at,
    flipped,
    header_with,
    remade,
    taken_apart,
)

_LAYER, _TABLES = 1, 2
_TOP = (1 << 64) - 1
_RESERVED = frozenset({"bad-reserved", "bad-profile", "bad-coordinate-frame", "bad-colour-space", "bad-page-bits"})


def container_faults(_files: Mapping[str, bytes]) -> Iterator[Case]:
    """One case for each way of breaking a rule of §5.1 to §5.6 or §5.8 that a careless reader would not see.

    The valid vectors are not needed: the bases are smaller than most of them.
    """
    yield from _signature_faults()
    yield from _header_faults()
    yield from _place_faults()
    yield from _layer_faults()
    yield from root_faults()
    yield from page_faults()
    yield from _block_faults()
    yield from zstd_faults(plain_file())
    yield from precedence_cases(plain_file(), paged_file())


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
    for name, major, minor in (("0-0", 0, 0), ("0-1", 0, 1), ("1-2", 1, 2), ("255-2", 255, 2)):
        data = sign + bytes([major, minor]) + base[11:]
        yield Case(
            f"invalid/version-{name}", f"version {major}.{minor}; the header's CRC does not count", data,
            ("R-5.1-2", "R-11-1"), refusals=("unsupported-version",), stage="container",
        )
    yield _case("version-only", "eleven bytes, version 0.3: refused before the missing rest",
                "R-5.1-2", "unsupported-version", sign + b"\0\3")


# ------------------------------------------------------------------------------------------------ §5.2


def _header_faults() -> Iterator[Case]:
    """Single fields of the header, in the order of the rules."""
    plain, anchors = plain_file(), anchor_file()
    rows: tuple[tuple[str, str, str, str, bytes, dict[str, object]], ...] = (
        ("version-reserved", "the byte after the version is 1", "R-5.2-5", "bad-reserved", plain,
         {"version_reserved": 1}),
        ("page-bits-top", "pages of 2^255 tiles", "R-5.2-14", "bad-page-bits", plain, {"page_bits": 255}),
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
    yield _case("layer-end-late", "layer 2 ends one byte late", "R-5.3-4", "layer-offset",
                broken(base, lambda p: p.layers[1].update(end_offset=p.layers[1]["end_offset"] + 1)))
    yield _case("layer-end-wrap", "bytes of layer 1 that bring its end back to before its start, modulo 2^64",
                "R-5.3-4", "layer-offset", broken(base, _wrapped_end))
    yield _case("layer-before-file", "layer 1 has more bytes than lie before its end, so its blocks begin below 0",
                "R-5.3-4", "layer-offset", broken(base, _bytes_before_file))
    yield _case("blocks-in-root", "the blocks begin at the last byte of ROOT", "R-5.3-4", "layer-offset",
                broken(base, _blocks_in_root))
    yield _case("root-beyond-blocks", "root_length is 2^24, the blocks begin before that", "R-5.3-4", "layer-offset",
                broken(base, header_with(root_length=1 << 24)))
    yield _case("file-length-more", "file_length is one more than the end of the last layer", "R-5.3-6",
                "bad-file-length", broken(base, header_with(file_length=len(base) + 1)) + b"\0")
    yield _case("file-length-less", "file_length is one less than the end of the last layer", "R-5.3-6",
                "bad-file-length", broken(base, header_with(file_length=len(base) - 1)))


def _streams(layer: Row, more: dict[int, int]) -> None:
    layer["stream_bytes"] = tuple(size + more.get(kind, 0) for kind, size in enumerate(layer["stream_bytes"]))


def _more_bytes(parts: Parts, layer: int, more: int) -> None:
    parts.layers[layer]["byte_count"] += more
    _streams(parts.layers[layer], {0: more})


def _bytes_before_file(parts: Parts) -> None:
    _more_bytes(parts, 0, parts.layers[0]["end_offset"])


def _blocks_in_root(parts: Parts) -> None:
    _more_bytes(parts, 0, parts.pages_length + 1)


def _wrapped_end(parts: Parts) -> None:
    """Layer 1 ends 16 bytes before its start, layer 2 where it did."""
    first, second = parts.layers
    back = first["byte_count"] + 16
    for layer, more in ((first, (1 << 64) - back), (second, back)):
        layer["byte_count"] += more
        _streams(layer, {0: more})
    first["end_offset"] -= back


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
