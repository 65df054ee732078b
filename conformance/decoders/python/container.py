"""The fields of SPEC.md §5.2 to §5.5, those of tiles and blocks unpacked from their pages: the stage ``container``.

The input is a file whose header, ROOT and pages are sound; only their checksums are compared.
"""

from __future__ import annotations

import zlib
from dataclasses import asdict
from typing import Any

from conformance.decoders.python.front import Root, read_entries, read_tiles

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
    ("page_bits", "u8", 1),
    ("tile_count", "u32", 1),
    ("root_length", "u32", 1),
    ("anchor_count", "u64", 1),
    ("gaussian_count", "u64", 1),
    ("origin", "f64", 3),
    ("voxel", "f64", 1),
    ("source_count", "u64", 1),
    ("root_crc32", "u32", 1),
)
LAYER_SUMMARY: Layout = (
    ("anchor_count", "u64", 1),
    ("gaussian_count", "u64", 1),
    ("byte_count", "u64", 1),
    ("end_offset", "u64", 1),
    ("stream_bytes", "u64", 13),
)
HEADER_CHECKSUM: Layout = (("header_crc32", "u32", 1),)
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
    """Every field of header and layer summaries, every tile, and an entry for every block."""
    header = fields_at(data, 0, FILE_HEADER)
    at = size_of(FILE_HEADER)
    layers = []
    for _ in range(int(header["layer_count"])):
        layers.append(fields_at(data, at, LAYER_SUMMARY))
        at += size_of(LAYER_SUMMARY)
    header |= fields_at(data, at, HEADER_CHECKSUM)
    root = Root(data)
    tiles = [_texts(tile._asdict()) for tile in read_tiles(data, root)]
    entries = [_texts(asdict(entry)) for entry in read_entries(data, root)]
    return {"header": header, "layers": layers, "tiles": tiles, "entries": entries}


def _texts(row: dict[str, int]) -> dict[str, str]:
    return {name: str(number) for name, number in row.items()}


def blocks_of_kind(data: bytes, kind: str) -> list[bytes]:
    """The payloads of the blocks of a kind, in file order."""
    entries = [entry for entry in container_fields(data)["entries"] if entry["kind"] == kind]
    return [data[int(e["offset"]) : int(e["offset"]) + int(e["length"])] for e in entries]


def profile_of(data: bytes) -> str | None:
    """``explicit`` or ``anchor``, None where a sound header of version 0.2 does not say so."""
    header = fields_at(data, 0, FILE_HEADER) if len(data) >= size_of(FILE_HEADER) else {}
    if not data.startswith(SIGNATURE + b"\0\2") or header.get("profile") not in ("0", "1"):
        return None
    crc = int(header["header_length"]) - 4
    if not 0 < crc <= len(data) - 4 or zlib.crc32(data[:crc]) != int.from_bytes(data[crc : crc + 4], "little"):
        return None
    return ("explicit", "anchor")[int(header["profile"])]
