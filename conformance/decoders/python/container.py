"""The structures of SPEC.md §5.2 to §5.5, field by field, with nothing but their tables: the stage ``container``.

The input is a file whose header, tile table and directory are sound; nothing is checked.
"""

from __future__ import annotations

import zlib
from typing import Any

Layout = tuple[tuple[str, str, int], ...]

FILE_HEADER: Layout = (
    ("signature", "bytes", 9),
    ("major", "u8", 1),
    ("minor", "u8", 1),
    ("version_reserved", "u8", 1),
    ("header_length", "u32", 1),
    ("file_length", "u64", 1),
    ("profile", "u8", 1),
    ("sh_degree", "u8", 1),
    ("layer_count", "u8", 1),
    ("slots", "u8", 1),
    ("lattice_bits", "u8", 1),
    ("coordinate_frame", "u8", 1),
    ("colour_space", "u8", 1),
    ("reserved", "u8", 1),
    ("tile_count", "u32", 1),
    ("entry_count", "u32", 1),
    ("anchor_count", "u64", 1),
    ("gaussian_count", "u64", 1),
    ("origin", "f64", 3),
    ("voxel", "f64", 1),
    ("source_count", "u64", 1),
    ("directory_crc32", "u32", 1),
)
LAYER_SUMMARY: Layout = (
    ("anchor_count", "u64", 1),
    ("gaussian_count", "u64", 1),
    ("byte_count", "u64", 1),
    ("end_offset", "u64", 1),
    ("stream_bytes", "u64", 13),
)
HEADER_CHECKSUM: Layout = (("header_crc32", "u32", 1),)
TILE_RECORD: Layout = (("depth", "u8", 1), ("shift", "u8", 1), ("reserved", "u16", 1), ("prefix", "u64", 1))
DIRECTORY_ENTRY: Layout = (
    ("kind", "u8", 1),
    ("flags", "u8", 1),
    ("layer", "u8", 1),
    ("reserved", "u8", 1),
    ("tile", "u32", 1),
    ("offset", "u64", 1),
    ("length", "u64", 1),
    ("count", "u32", 1),
    ("crc32", "u32", 1),
)
SIGNATURE = bytes.fromhex("89534341520d0a1a0a")
METADATA_KIND, STREAMING_KIND = "64", "65"
_SIZES = {"u8": 1, "u16": 2, "u32": 4, "u64": 8, "f64": 8}


def size_of(layout: Layout) -> int:
    """Bytes of a structure."""
    return sum(count if kind == "bytes" else count * _SIZES[kind] for _, kind, count in layout)


def fields_at(data: bytes, at: int, layout: Layout) -> dict[str, Any]:
    """The fields of a structure at a byte offset, in the notation of the protocol."""
    out: dict[str, Any] = {}
    for name, kind, count in layout:
        size = count if kind == "bytes" else _SIZES[kind]
        numbers = [data[at + i * size : at + (i + 1) * size] for i in range(1 if kind == "bytes" else count)]
        shown = [_shown(number, kind) for number in numbers]
        out[name] = shown[0] if len(shown) == 1 else shown
        at += size * len(shown)
    return out


def _shown(number: bytes, kind: str) -> str:
    if kind == "bytes":
        return number.hex()
    return number[::-1].hex() if kind == "f64" else str(int.from_bytes(number, "little"))


def container_fields(data: bytes) -> dict[str, Any]:
    """Every field of header, layer summaries, tile table and directory."""
    header = fields_at(data, 0, FILE_HEADER)
    at = size_of(FILE_HEADER)
    out: dict[str, Any] = {"header": header}
    layers, at = _rows(data, at, LAYER_SUMMARY, int(header["layer_count"]))
    header |= fields_at(data, at, HEADER_CHECKSUM)
    tiles, at = _rows(data, at + size_of(HEADER_CHECKSUM), TILE_RECORD, int(header["tile_count"]))
    entries, _ = _rows(data, at, DIRECTORY_ENTRY, int(header["entry_count"]))
    return {**out, "layers": layers, "tiles": tiles, "entries": entries}


def _rows(data: bytes, at: int, layout: Layout, count: int) -> tuple[list[dict[str, Any]], int]:
    """`count` structures from an offset, and the offset past them."""
    size = size_of(layout)
    return [fields_at(data, at + i * size, layout) for i in range(count)], at + count * size


def blocks_of_kind(data: bytes, kind: str) -> list[bytes]:
    """The payloads of the blocks of a kind, in file order."""
    entries = [entry for entry in container_fields(data)["entries"] if entry["kind"] == kind]
    return [data[int(e["offset"]) : int(e["offset"]) + int(e["length"])] for e in entries]


def profile_of(data: bytes) -> str | None:
    """``explicit`` or ``anchor``, None where a sound header of version 0.1 does not say so."""
    header = fields_at(data, 0, FILE_HEADER) if len(data) >= size_of(FILE_HEADER) else {}
    if not data.startswith(SIGNATURE + b"\0\1") or header.get("profile") not in ("0", "1"):
        return None
    crc = int(header["header_length"]) - 4
    if not 0 < crc <= len(data) - 4 or zlib.crc32(data[:crc]) != int.from_bytes(data[crc : crc + 4], "little"):
        return None
    return ("explicit", "anchor")[int(header["profile"])]
