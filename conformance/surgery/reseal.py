"""Checksums made right in files that are damaged, so that what lies behind them is reached."""

from __future__ import annotations

import contextlib
import struct
import zlib

from conformance.decoders.python.fields import Payload, Refused
from conformance.decoders.python.front import SIGNATURE, TILE, Root
from conformance.spec.spec_text import size_of
from conformance.surgery.parts import field_at, unpack
from conformance.writer import pages

_CRC = struct.Struct("<I")


def is_file(data: bytes) -> bool:
    """Whether the bytes start like a file of this format that is long enough for a header of one layer."""
    return len(data) >= _header_length(1) and data.startswith(SIGNATURE)


def _header_length(layers: int) -> int:
    return size_of("FILE_HEADER") + size_of("LAYER_SUMMARY") * layers + size_of("HEADER_CHECKSUM")


def reseal(data: bytes) -> bytes:
    """The file with the checksums of sub-streams, blocks, pages, ROOT and header made right where they can be found."""
    if len(data) < _header_length(0):
        return data
    out = bytearray(data)
    header = unpack("FILE_HEADER", data)
    length = header["header_length"]
    if length == _header_length(header["layer_count"]):
        _seal_root(out, length, length + header["root_length"])
        with contextlib.suppress(Refused, struct.error):
            _seal_directory(out, length)
            _seal_root(out, length, length + header["root_length"])
    if _header_length(0) <= length <= len(out):
        _CRC.pack_into(out, length - _CRC.size, zlib.crc32(out[: length - _CRC.size]))
    return bytes(out)


def _seal_root(out: bytearray, start: int, past: int) -> None:
    _CRC.pack_into(out, field_at("FILE_HEADER", "root_crc32"), zlib.crc32(out[start:past]))


def _seal_directory(out: bytearray, start: int) -> None:
    """Make the checksums of blocks and pages right, those of ROOT's own rows included."""
    root = Root(bytes(out))
    models = [[pages.ModelRow(*row) for row in rows] for rows in root.models]
    with contextlib.suppress(Refused, struct.error):  # a row page is damaged: where later blocks lie is not known
        _seal_blocks(out, root, models)
    listed, before = [], 0
    for number, page in enumerate(root.pages):
        span = root.tile_pages[number]
        rows = [
            pages.RootRow(row.size, _sum(out, *root.row_pages[layer, number][:2]), row.block_bytes, row.anchors)
            if row.size
            else pages.RootRow()
            for layer, row in enumerate(page.rows, start=1)
        ]
        listed.append(pages.RootPage(page.base - before, page.size, _sum(out, span.start, span.past), rows))
        before = page.base
    packed = pages.Root(models, listed).pack()
    out[start : start + len(packed)] = packed


def _seal_blocks(out: bytearray, root: Root, models: list[list[pages.ModelRow]]) -> None:
    at = root.blocks
    for layer, rows in enumerate(models, start=1):
        for row in (row for row in rows if row.kind < TILE):
            row.crc32 = _block_sum(out, at, row.length, row.crc32)
            at += row.length
        for number in range(len(root.pages)):
            at = _seal_rows(out, root, (layer, number), at)
        for row in (row for row in rows if row.kind >= TILE):
            row.crc32 = _block_sum(out, at, row.length, row.crc32)
            at += row.length


def _seal_rows(out: bytearray, root: Root, page: tuple[int, int], at: int) -> int:
    """Make the checksums of the TILE blocks of a row page right, and those in them; the end of the last block."""
    if page not in root.row_pages:
        return at
    start, past, _ = root.row_pages[page]
    reader = Payload(bytes(out[start:past]))
    lengths = [length for length in [reader.varint(53) for _ in range(root.tiles_in(page[1]))] if length]
    for _ in lengths:
        reader.varint(32)
    for length in lengths:
        if at + length <= len(out):
            out[at : at + length] = reseal_tile(bytes(out[at : at + length]))
        (known,) = reader.fields("I")
        _CRC.pack_into(out, start + reader.at - _CRC.size, _block_sum(out, at, length, known))
        at += length
    return at


def _block_sum(out: bytearray, at: int, length: int, known: int) -> int:
    return _sum(out, at, at + length) if 0 < length <= len(out) - at else known


def _sum(out: bytearray, start: int, past: int) -> int:
    return zlib.crc32(out[start:past])


def reseal_tile(payload: bytes) -> bytes:
    """A TILE block with all its checksums made right, as far as its table makes sense."""
    record = size_of("SUBSTREAM_RECORD")
    size = 1 + record * payload[0] if payload else 0
    if not size or size + _CRC.size > len(payload):
        return payload
    out = bytearray(payload)
    at = size + _CRC.size
    for start in range(1, size, record):
        length = unpack("SUBSTREAM_RECORD", payload, start)["length"]
        _CRC.pack_into(out, start + record - _CRC.size, _sum(out, at, at + length))
        at += length
    _CRC.pack_into(out, size, _sum(out, 0, size))
    return bytes(out)
