"""A file taken apart by the tables of SPEC.md, and put together again with whatever numbers are in it.

Nothing is checked and nothing of the package is used: this is how the faults of the container are put in.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from conformance.spec.spec_text import Place, place_of, size_of, structure

Row = dict[str, Any]
Change = Callable[["Parts"], object]
NO_TILE = 0xFFFFFFFF
TILE_KIND = 16
_STREAMS, _MODELS, _FRAMING = 13, 0, 12
_CODES = {"u8": "B", "u16": "H", "u32": "I", "u64": "Q", "f64": "d"}


def unpack(name: str, data: bytes, start: int = 0) -> Row:
    """The numbers of a structure: integers, floats, or tuples of them; the signature as bytes."""
    return {place.name: _number(place, data, start + place.offset) for place in structure(name)}


def _number(place: Place, data: bytes, start: int) -> Any:
    if place.name == "signature":
        return data[start : start + place.size]
    found = struct.unpack_from(f"<{place.numbers or 1}{_CODES[place.type]}", data, start)
    return found[0] if place.single else found


def pack(name: str, row: Row) -> bytes:
    """The bytes of a structure."""
    return b"".join(_bytes(place, row[place.name]) for place in structure(name))


def _bytes(place: Place, value: Any) -> bytes:
    if isinstance(value, bytes):
        return value
    numbers = (value,) if place.single else value
    return struct.pack(f"<{len(numbers)}{_CODES[place.type]}", *numbers)


def _rows(name: str, data: bytes, start: int, count: int) -> list[Row]:
    return [unpack(name, data, start + i * size_of(name)) for i in range(count)]


@dataclass
class Parts:
    """The structures of a file in file order, as rows that can be changed; `blocks` in the order of `entries`."""

    header: Row
    layers: list[Row]
    tiles: list[Row]
    entries: list[Row]
    blocks: list[bytes]

    def entry(self, kind: int, layer: int = 1, tile: int | None = None) -> Row:
        """The entry of a block; without `tile` the first of that kind."""
        return self.entries[self.row(kind, layer, tile)]

    def row(self, kind: int, layer: int = 1, tile: int | None = None) -> int:
        """Where that entry stands in the directory."""
        return next(
            number for number, entry in enumerate(self.entries)
            if (entry["kind"], entry["layer"]) == (kind, layer) and tile in (None, entry["tile"])
        )

    def put(self, kind: int, layer: int, change: Callable[[bytes], bytes]) -> None:
        """Another payload for the first block of `kind` in a layer, made from the one it has."""
        row = self.row(kind, layer)
        self.blocks[row] = change(self.blocks[row])

    def insert(self, row: int, payload: bytes = b"?", **entry: int) -> None:
        """One more block, its entry at `row`; fields not given are those of a private, ancillary block of layer 1."""
        plain = {"kind": 200, "flags": 0, "layer": 1, "reserved": 0, "tile": NO_TILE, "count": 0}
        self.entries.insert(row, {**plain, **entry, "offset": 0, "length": 0, "crc32": 0})
        self.blocks.insert(row, payload)

    def add(self, payload: bytes = b"?", **entry: int) -> None:
        """A copy with one block more, after the last of its layer."""
        layer = entry.get("layer", 1)
        self.insert(sum(known["layer"] <= layer for known in self.entries), payload, **entry)

    def remove(self, row: int) -> None:
        """A block and its entry."""
        del self.entries[row], self.blocks[row]

    def swap(self, first: int, second: int) -> None:
        """Two blocks change places, with their entries."""
        self.entries[first], self.entries[second] = self.entries[second], self.entries[first]
        self.blocks[first], self.blocks[second] = self.blocks[second], self.blocks[first]

    def settle(self) -> None:
        """Make right every number that says how large something is or where it lies."""
        self.header["layer_count"] = len(self.layers)
        self.header["tile_count"], self.header["entry_count"] = len(self.tiles), len(self.entries)
        self.header["header_length"] = self._header_length()
        end = self._header_length() + size_of("TILE_RECORD") * len(self.tiles)
        end += size_of("DIRECTORY_ENTRY") * len(self.entries)
        at = end
        for entry, block in zip(self.entries, self.blocks, strict=True):
            entry["offset"], entry["length"], entry["crc32"] = at, len(block), zlib.crc32(block)
            at += len(block)
        for number, layer in enumerate(self.layers, start=1):
            streams = self._stream_bytes(number)
            end += sum(streams)
            layer.update(stream_bytes=tuple(streams), byte_count=sum(streams), end_offset=end)
        self.header["file_length"] = end
        for name in ("anchor_count", "gaussian_count"):
            self.header[name] = self.layers[-1][name] if self.layers else 0

    def _header_length(self) -> int:
        return size_of("FILE_HEADER") + size_of("LAYER_SUMMARY") * len(self.layers) + size_of("HEADER_CHECKSUM")

    def _stream_bytes(self, layer: int) -> list[int]:
        streams = [0] * _STREAMS
        for entry, block in zip(self.entries, self.blocks, strict=True):
            if entry["layer"] == layer:
                streams[_FRAMING if entry["kind"] == TILE_KIND else _MODELS] += len(block)
                for kind, length in substreams(block) if entry["kind"] == TILE_KIND else ():
                    streams[kind] += length
                    streams[_FRAMING] -= length
        return streams

    def tables(self) -> bytes:
        """Tile table and directory."""
        return b"".join(
            [*(pack("TILE_RECORD", tile) for tile in self.tiles), *(pack("DIRECTORY_ENTRY", e) for e in self.entries)]
        )

    def raw(self) -> bytes:
        """The file as the rows say; only the header's own checksum is made right."""
        front = pack("FILE_HEADER", self.header) + b"".join(pack("LAYER_SUMMARY", layer) for layer in self.layers)
        return b"".join([front, struct.pack("<I", zlib.crc32(front)), self.tables(), *self.blocks])

    def sealed(self) -> bytes:
        """A copy whose checksum of tile table and directory is right."""
        self.header["directory_crc32"] = zlib.crc32(self.tables())
        return self.raw()


def substreams(block: bytes) -> Iterator[tuple[int, int]]:
    """Stream kind and length of every record of a TILE block."""
    for row in _rows("SUBSTREAM_RECORD", block, 1, block[0]):
        yield row["stream"], row["length"]


def taken_apart(data: bytes) -> Parts:
    """The parts of a sound file."""
    header = unpack("FILE_HEADER", data)
    layers = _rows("LAYER_SUMMARY", data, size_of("FILE_HEADER"), header["layer_count"])
    tiles = _rows("TILE_RECORD", data, header["header_length"], header["tile_count"])
    directory = header["header_length"] + size_of("TILE_RECORD") * len(tiles)
    entries = _rows("DIRECTORY_ENTRY", data, directory, header["entry_count"])
    blocks = [data[entry["offset"] : entry["offset"] + entry["length"]] for entry in entries]
    return Parts(header, layers, tiles, entries, blocks)


def broken(data: bytes, change: Change) -> bytes:
    """The file with rows changed, and nothing made right but the checksums of the front."""
    parts = taken_apart(data)
    change(parts)
    return parts.sealed()


def remade(data: bytes, change: Change) -> bytes:
    """The file with parts changed, and every size, offset, sum and checksum made right."""
    parts = taken_apart(data)
    change(parts)
    parts.settle()
    return parts.sealed()


def field_at(name: str, field: str, start: int = 0, number: int = 0) -> int:
    """Absolute offset of a field of a structure at `start`; of its given number if it has several."""
    place = place_of(name, field)
    return start + place.offset + (number * place.size // place.numbers if place.numbers else 0)


def header_with(**numbers: Any) -> Change:
    """A change of header fields."""
    return lambda parts: parts.header.update(numbers)


def block_with(kind: int, payload: bytes, layer: int = 1) -> Change:
    """A change of the payload of the first block of `kind` in a layer."""
    return lambda parts: parts.put(kind, layer, lambda _: payload)


def block_added(payload: bytes = b"?", **entry: int) -> Change:
    """One more block, as :meth:`Parts.add`."""
    return lambda parts: parts.add(payload, **entry)


def flipped(data: bytes, offset: int, mask: int = 1) -> bytes:
    """The file with some bits of one byte inverted."""
    return data[:offset] + bytes([data[offset] ^ mask]) + data[offset + 1 :]
