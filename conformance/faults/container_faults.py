"""Files that break exactly one rule of header, layer summaries or blocks (SPEC §5.1-§5.3, §5.6), checksums right unless
they are the fault. Those of ROOT and pages are in :mod:`.root_faults` and :mod:`.page_faults`.

Small files of :mod:`conformance.scenes.container_scenes` are taken apart by the tables of SPEC.md, changed, and put
together.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from conformance.faults.page_faults import page_faults
from conformance.faults.precedence import precedence_cases
from conformance.faults.root_faults import root_faults
from conformance.scenes.cases import Case, Fault, refuse
from conformance.scenes.container_scenes import anchor_file, paged_file, plain_file
from conformance.spec.spec_text import size_of
from conformance.surgery.edit import Changes, more, plus, splice
from conformance.surgery.parts import (
    TILE_KIND,
    change_rows,
    entry_with,
    field_at,
    flip_bits,
    header_with,
    remake,
    take_apart,
)

_LAYER, _TABLES = 1, 2
_TOP = (1 << 64) - 1
# Of what is reserved: no reader ignores it.
_RESERVED = frozenset({"bad-reserved", "bad-profile", "bad-coordinate-frame", "bad-colour-space", "bad-page-bits"})


def container_faults() -> Iterator[Case]:
    """One case for each way of breaking a rule of §5.1 to §5.6 that a careless reader would not see."""
    plain, anchors = plain_file(), anchor_file()
    for faults in (
        _signature_faults(plain), _header_faults(plain, anchors), _voxel_faults(plain), _place_faults(plain),
        _count_faults(plain, anchors), _byte_faults(plain),
    ):
        yield from (refuse(*fault, stage="container") for fault in faults)
    yield from root_faults()
    yield from page_faults()
    yield from _block_faults(plain)
    yield from precedence_cases(plain, anchors, paged_file())


# ------------------------------------------------------------------------------------------------ §5.1


def _signature_faults(base: bytes) -> Iterator[Fault]:
    sign, rest = base[:9], base[9:]
    damaged, bad, version = "damaged-signature", "bad-signature", ("R-5.1-2 R-11-1", "unsupported-version")
    for name, purpose, refusal, data in (
        ("crlf", "LF became CR LF everywhere in the signature", damaged, b"\x89SCAR\r\r\n\x1a\r\n" + rest),
        ("cr", "CR LF became CR", damaged, sign.replace(b"\r\n", b"\r") + rest),
        ("7-bit", "the high bit of the first byte was stripped", damaged, bytes([sign[0] & 0x7F]) + base[1:]),
        ("utf-8", "the first byte became two, as Latin-1 text turned into UTF-8", damaged, b"\xc2" + base),
        ("late", "SCAR in the last four of the first eight bytes", damaged, b"\0\0\0" + base),
        ("1a-cut", "the file ends before the byte 1A and has another byte there", damaged, sign[:7] + b"\n"),
        ("later", "SCAR one byte later than it is looked for", bad, b"\0\0\0\0" + base),
        ("lower", "small letters", bad, sign.replace(b"SCAR", b"scar") + rest),
        ("zeros", "as long as a header, all zeros", bad, bytes(240)),
        ("short", "three bytes, none of which are the signature's", bad, b"SCA"),
    ):
        yield f"signature-{name}", purpose, "R-5.1-1", refusal, data
    for major, minor in ((0, 0), (0, 2), (1, 3), (255, 3)):
        yield (f"version-{major}-{minor}", f"version {major}.{minor}; the header's CRC does not count", *version,
               splice(9, bytes([major, minor]), 2)(base))
    yield ("version-only", "eleven bytes, version 0.4: refused before the missing rest", "R-5.1-2",
           "unsupported-version", sign + b"\0\4")


# ------------------------------------------------------------------------------------------------ §5.2


def _header_faults(plain: bytes, anchors: bytes) -> Iterator[Fault]:
    """Single fields of the header, in the order of the rules."""
    rows: tuple[tuple[str, str, str, str, bytes, dict[str, object]], ...] = (
        ("render-model-three", "render model 3", "R-5.2-5", "bad-reserved", plain, {"render_model": 3}),
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
        rules = f"{rule} R-11-2" if refusal in _RESERVED else rule
        yield name, purpose, rules, refusal, change_rows(base, header_with(**change))


def _voxel_faults(base: bytes) -> Iterator[Fault]:
    positive, reach = "R-5.2-16", "R-5.2-17"
    rows: tuple[tuple[str, str, str, float, float], ...] = (
        ("zero", "voxel is 0.0", positive, 0.0, 0.0),
        ("minus-zero", "voxel is -0.0", positive, -0.0, 0.0),
        ("negative", "voxel is -1.0", positive, -1.0, 0.0),
        ("nan", "voxel is nan", positive, math.nan, 0.0),
        ("infinite", "voxel is inf", positive, math.inf, 0.0),
        ("reach", "voxel * 2^33 is infinite", reach, 1e300, 0.0),
        # 2^1023 + 2^1023 overflows; each alone is finite.
        ("origin-reach", "|z of the origin| + voxel * 2^33 is infinite, neither of them alone", reach, 2.0**990,
         -(2.0**1023)),
    )
    for name, purpose, rule, voxel, z in rows:
        origin = {"origin": (0.0, 0.0, z)} if rule == reach else {}
        yield f"voxel-{name}", purpose, rule, "bad-voxel", change_rows(base, header_with(voxel=voxel, **origin))


def _place_faults(base: bytes) -> Iterator[Fault]:
    """Lengths and checksums of the header."""
    length, bad = take_apart(base).header["header_length"], ("R-5.2-2", "bad-header-length")
    damaged = "R-5.2-4", "header-crc-mismatch"
    for name, number in (("104", 104), ("odd", length + 1), ("top", (1 << 32) - 1)):
        yield (f"header-length-{name}", f"header_length is {number}", *bad,
               change_rows(base, header_with(header_length=number)))
    yield ("no-layers", "a file without layers, consistent otherwise", *bad,
           remake(base, {name: [] for name in ("layers", "tiles", "entries", "blocks")}))
    yield ("seventeen-layers", "17 layers, consistent otherwise", *bad,
           remake(base, lambda p: p.layers.extend(dict(p.layers[-1]) for _ in range(15))))
    yield "header-crc", "the CRC itself is wrong", *damaged, flip_bits(base, length - size_of("HEADER_CHECKSUM"))
    summary = field_at("LAYER_SUMMARY", "stream_bytes", size_of("FILE_HEADER") + size_of("LAYER_SUMMARY"), 12)
    yield "summary-bit", "one bit of the last layer summary is flipped", *damaged, flip_bits(base, summary)


# ------------------------------------------------------------------------------------------------ §5.3


def _count_faults(plain: bytes, anchors: bytes) -> Iterator[Fault]:
    def last(**counts: int) -> Changes:
        """Counts of the last layer and of the header."""
        return {f"{row}.{name}_count": count for row in ("layers.1", "header") for name, count in counts.items()}

    first, second = take_apart(plain).layers
    before, after = take_apart(anchors).layers
    slots, fall, more_than = take_apart(anchors).header["slots"], "R-5.3-1", "R-5.3-2"
    fewer = first["anchor_count"] - 1
    rows: tuple[tuple[str, str, str, bytes, Changes], ...] = (
        ("anchors-fall", "layer 2 has fewer anchors than layer 1", fall, plain, last(anchor=fewer, gaussian=fewer)),
        ("anchors-fall-alone", "layer 2 has fewer anchors than layer 1, but not fewer Gaussians", fall, anchors,
         {"layers.0.anchor_count": after["anchor_count"] + 1}),
        ("gaussians-fall", "layer 2 has fewer Gaussians than layer 1, but more anchors", fall, anchors,
         last(gaussian=before["gaussian_count"] - 1)),
        ("gaussians-more", "more Gaussians than anchors in the explicit profile", more_than, plain,
         last(gaussian=second["anchor_count"] + 1)),
        ("gaussians-beyond-slots", "one Gaussian more than anchors times slots", more_than, anchors,
         last(gaussian=slots * after["anchor_count"] + 1)),
        *((f"header-{name}-count", f"{name}_count of the header is not that of the last layer", "R-5.3-5", plain,
           {f"header.{name}_count": more}) for name in ("anchor", "gaussian")),
    )
    for name, purpose, rule, data, changes in rows:
        yield name, purpose, rule, "layer-counts", change_rows(data, changes)


def _byte_faults(base: bytes) -> Iterator[Fault]:
    sums, place, length = ("R-5.3-3", "layer-bytes"), ("R-5.3-4", "layer-offset"), ("R-5.3-6", "bad-file-length")
    first, pages = take_apart(base).layers[0], take_apart(base).pages_length
    back = first["byte_count"] + 16

    def bytes_of(layer: int, by: int) -> Changes:
        return {f"layers.{layer}.byte_count": plus(by), f"layers.{layer}.stream_bytes.0": plus(by)}

    rows: tuple[tuple[str, str, tuple[str, str], Changes], ...] = (
        ("layer-bytes-less", "stream_bytes sum to one less than byte_count", sums,
         {"layers.1.stream_bytes.12": plus(-1)}),
        ("layer-bytes-wrap", "stream_bytes sum to byte_count modulo 2^64", sums,
         {"layers.0.stream_bytes.1": plus(1 << 63), "layers.0.stream_bytes.9": plus(1 << 63)}),
        ("layer-end", "end_offset of layer 1 is one byte late", place, {"layers.0.end_offset": more}),
        ("layer-end-late", "layer 2 ends one byte late", place, {"layers.1.end_offset": more}),
        # Layer 1 ends 16 bytes before its start, layer 2 where it did.
        ("layer-end-wrap", "bytes of layer 1 that bring its end back to before its start, modulo 2^64", place,
         {**bytes_of(0, (1 << 64) - back), **bytes_of(1, back), "layers.0.end_offset": plus(-back)}),
        ("layer-before-file", "layer 1 has more bytes than lie before its end, so its blocks begin below 0", place,
         bytes_of(0, first["end_offset"])),
        ("blocks-in-root", "the blocks begin at the last byte of ROOT", place, bytes_of(0, pages + 1)),
        ("root-beyond-blocks", "root_length is 2^24, the blocks begin before that", place,
         header_with(root_length=1 << 24)),
        ("file-length-less", "file_length is one less than the end of the last layer", length,
         header_with(file_length=len(base) - 1)),
    )
    for name, purpose, rule, changes in rows:
        yield name, purpose, *rule, change_rows(base, changes)
    yield ("file-length-more", "file_length is one more than the end of the last layer", *length,
           change_rows(base, header_with(file_length=len(base) + 1)) + b"\0")
    yield "trailing-4-kib", "zeros up to a whole sector", "R-5.3-7", "trailing-bytes", base + bytes(4096 - len(base))


# ------------------------------------------------------------------------------------------------ §5.6


def _block_faults(base: bytes) -> Iterator[Case]:
    for name, kind, layer in (("layer", _LAYER, 2), ("tables", _TABLES, 1), ("tile", TILE_KIND, 2)):
        data = change_rows(base, entry_with(kind, layer, crc32=lambda crc: crc ^ 1))
        yield refuse(f"entry-crc-{name}", f"the entry of a {name.upper()} block has a wrong CRC", "R-5.6-1",
                     "crc-mismatch", data, "tiles" if name == "tile" else "models")
