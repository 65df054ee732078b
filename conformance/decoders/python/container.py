"""The fields of SPEC.md §5.2 to §5.5, those of tiles and blocks unpacked from their pages: the stage ``container``."""

from __future__ import annotations

import struct
import zlib
from dataclasses import asdict
from typing import Any

from conformance.decoders.python.fields import require
from conformance.decoders.python.front import (
    EXACT,
    FILE_HEADER,
    HEADER_CHECKSUM,
    LAYER_SUMMARY,
    LIMITS,
    SIGNATURE,
    Layout,
    Limits,
    Root,
    numbers_at,
    read_entries,
    read_header,
    read_tiles,
    size_of,
)

METADATA_KIND, STREAMING_KIND = 64, 65


def fields_at(data: bytes, at: int, layout: Layout) -> dict[str, Any]:
    """The fields of a structure at a byte offset, in the notation of the protocol."""
    return {name: _show(number) for name, number in numbers_at(data, at, layout).items()}


def _show(number: Any) -> Any:
    if isinstance(number, tuple):
        return [_show(one) for one in number]
    if isinstance(number, bytes):
        return number.hex()
    return struct.pack(">d", number).hex() if isinstance(number, float) else str(number)


def container_fields(data: bytes, limits: Limits = LIMITS) -> dict[str, Any]:
    """Every field of header and layer summaries, every tile, and an entry for every block.

    Raises:
        Refused: the header, ROOT or a page is not sound.
    """
    summaries = read_header(data, limits)
    root = Root(data, limits)
    root.check(*summaries)
    header = fields_at(data, 0, FILE_HEADER)
    at = size_of(FILE_HEADER)
    layers = []
    for _ in range(int(header["layer_count"])):
        layers.append(fields_at(data, at, LAYER_SUMMARY))
        at += size_of(LAYER_SUMMARY)
    header |= fields_at(data, at, HEADER_CHECKSUM)
    tiles = [_texts(tile._asdict()) for tile in read_tiles(data, root)]
    entries = [_texts(asdict(entry)) for entry in read_entries(data, root)]
    return {"header": header, "layers": layers, "tiles": tiles, "entries": entries}


def _texts(row: dict[str, int]) -> dict[str, str]:
    return {name: str(number) for name, number in row.items()}


def annotation(data: bytes, kind: int, most: int = EXACT, limits: Limits = LIMITS) -> bytes | None:
    """The block of a kind in layer 1 that belongs to no tile, where METADATA (R-5.4-6) and STREAMING (R-7.13-2) stand.

    Raises:
        Refused: the header or ROOT is not sound; the block has more bytes than `most`, or another CRC.
    """
    summaries = read_header(data, limits)
    root = Root(data, limits)
    root.check(*summaries)
    # No page is read: ROOT says how many bytes the TILE blocks in between have.
    start = root.blocks + sum(page.rows[0].block_bytes for page in root.pages)
    for number, _, length, _, crc in root.models[0]:
        if number == kind:
            require(length <= most, "limit-metadata")
            block = data[start : start + length]
            require(zlib.crc32(block) == crc, "crc-mismatch")
            return block
        start += length
    return None


def profile_of(data: bytes) -> str | None:
    """``explicit`` or ``anchor``, None where a sound header of version 0.3 does not say so."""
    header = fields_at(data, 0, FILE_HEADER) if len(data) >= size_of(FILE_HEADER) else {}
    if not data.startswith(SIGNATURE + b"\0\3") or header.get("profile") not in ("0", "1"):
        return None
    crc = int(header["header_length"]) - 4
    if not 0 < crc <= len(data) - 4 or zlib.crc32(data[:crc]) != int.from_bytes(data[crc : crc + 4], "little"):
        return None
    return ("explicit", "anchor")[int(header["profile"])]
