"""A file taken apart by the tables of SPEC.md, and put together again with whatever numbers are in it.

Header and summaries follow the tables; ROOT and pages are read by the second decoder and packed by the second writer.
Nothing is checked and nothing of the package is used: this is how the faults of the container are put in.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any, TypeVar

from conformance.decoders.python.front import NO_TILE, Root, read_entries, read_tiles
from conformance.spec.spec_text import Place, place_of, size_of, structure
from conformance.surgery.edit import Changes, edit
from conformance.writer.pages import ModelRow, Pages, TileRow, make_pages

T = TypeVar("T")
Row = dict[str, Any]
Change = Callable[["Parts"], object] | Changes
PageChange = Callable[[Pages], object] | Changes
"""Changes something in place, or says which fields have other values."""
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
    """The contents of a file as rows that can be changed; `blocks` in the order of `entries`.

    ROOT and the pages are made from `tiles` and `entries`. Their `offset`s are told to whoever looks, and nothing is
    made from them: blocks lie one after the other. `root_length` and `pages_length` are what the numbers of `header`
    and `layers` reckon with. `streams` of an entry are the bytes of its sub-streams, where its table does not say them.
    """

    header: Row
    layers: list[Row]
    tiles: list[Row]
    entries: list[Row]
    blocks: list[bytes]
    page_bits: int
    root_length: int = 0
    pages_length: int = 0

    def row(self, kind: int, layer: int = 1) -> int:
        """The row of the first entry of that kind in the directory."""
        return next(n for n, entry in enumerate(self.entries) if (entry["kind"], entry["layer"]) == (kind, layer))

    def insert(self, row: int, payload: bytes = b"?", **entry: int) -> None:
        """One more block, its entry at `row`; fields not given are those of a private, ancillary block of layer 1."""
        plain = {"kind": 200, "flags": 0, "layer": 1, "tile": NO_TILE, "count": 0}
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
        self.header["tile_count"], self.header["page_bits"] = len(self.tiles), self.page_bits
        self.header["header_length"] = self._header_length()
        for entry, block in zip(self.entries, self.blocks, strict=True):
            entry["length"], entry["crc32"] = len(block), zlib.crc32(block)
        pages = self.pages()
        self.root_length, self.pages_length = len(pages.root.pack()), len(pages.pack_pages())
        self.header["root_length"] = self.root_length
        end = self._header_length() + self.root_length + self.pages_length
        at = end
        for entry in self.entries:
            entry["offset"] = at
            at += entry["length"]
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
                found = entry["streams"] if "streams" in entry else substreams(block)
                for kind, length in found if entry["kind"] == TILE_KIND else ():
                    streams[kind] += length
                    streams[_FRAMING] -= length
        return streams

    def pages(self) -> Pages:
        """ROOT and pages as tiles and entries say."""
        cubes = [(tile["depth"], tile["shift"], tile["prefix"]) for tile in self.tiles]
        models: list[list[ModelRow]] = [[] for _ in self.layers]
        rows = []
        for entry in self.entries:
            length, count, crc = entry["length"], entry["count"], entry["crc32"]
            if entry["kind"] == TILE_KIND:
                rows.append(TileRow(entry["layer"], entry["tile"], length, count, crc))
            else:
                models[entry["layer"] - 1].append(ModelRow(entry["kind"], entry["flags"], length, count, crc))
        return make_pages(cubes, models, rows, self.page_bits)

    def raw(self, pages: bytes | None = None) -> bytes:
        """The file as the rows say, or with other ROOT and pages; only the header's checksum is made right."""
        made = self.pages()
        between = made.root.pack() + made.pack_pages() if pages is None else pages
        front = pack("FILE_HEADER", self.header) + b"".join(pack("LAYER_SUMMARY", layer) for layer in self.layers)
        return b"".join([front, struct.pack("<I", zlib.crc32(front)), between, *self.blocks])

    def seal(self, pages: Pages | None = None) -> bytes:
        """The file, the header right about where ROOT ends, its checksum and where the blocks begin.

        Args:
            pages: ROOT and pages; None for those the rows say.
        """
        made = self.pages() if pages is None else pages
        return self.join(made.root.pack(), made.pack_pages())

    def join(self, root: bytes, pages: bytes) -> bytes:
        """The bytes of the file, with any bytes for ROOT and for the pages."""
        longer = len(root) - self.root_length
        later = longer + len(pages) - self.pages_length
        self.root_length, self.pages_length = len(root), len(pages)
        self.header["root_length"] += longer
        if later:
            self.header["file_length"] += later
            for layer in self.layers:
                layer["end_offset"] += later
        self.header["root_crc32"] = zlib.crc32(root)
        return self.raw(root + pages)


def substreams(block: bytes) -> Iterator[tuple[int, int]]:
    """Stream kind and length of every record of a TILE block."""
    for row in _rows("SUBSTREAM_RECORD", block, 1, block[0]):
        yield row["stream"], row["length"]


def take_apart(data: bytes) -> Parts:
    """The parts of a file whose ROOT and pages are sound."""
    header = unpack("FILE_HEADER", data)
    layers = _rows("LAYER_SUMMARY", data, size_of("FILE_HEADER"), header["layer_count"])
    root = Root(data)
    tiles = [tile._asdict() for tile in read_tiles(data, root)]
    entries = [asdict(entry) for entry in read_entries(data, root)]
    blocks = [data[entry["offset"] : entry["offset"] + entry["length"]] for entry in entries]
    pages = root.blocks - header["header_length"] - header["root_length"]
    return Parts(header, layers, tiles, entries, blocks, root.page_bits, header["root_length"], pages)


def change_rows(data: bytes, change: Change) -> bytes:
    """The file with rows changed, and nothing made right but the checksums of the front."""
    parts = _with(take_apart(data), change)
    return parts.seal()


def _with(value: T, change: Callable[[T], object] | Changes) -> T:
    if isinstance(change, Mapping):
        made: T = edit(value, change)
        return made
    change(value)
    return value


def remake(data: bytes, change: Change) -> bytes:
    """The file with parts changed, and every size, offset, sum and checksum made right."""
    parts = _with(take_apart(data), change)
    parts.settle()
    return parts.seal()


def change_pages(data: bytes, contents: PageChange | None = None, root: PageChange | None = None) -> bytes:
    """The file with numbers of pages changed; then ROOT is made right about their bytes, and changed itself."""
    parts = take_apart(data)
    pages = parts.pages()
    if contents is not None:
        pages = _with(pages, contents)
        pages.settle()
    if root is not None:
        pages = _with(pages, root)
    return parts.seal(pages)


def change_root(data: bytes, change: Callable[[bytes], bytes]) -> bytes:
    """The file with the bytes of ROOT changed, its length and checksum right."""
    parts = take_apart(data)
    pages = parts.pages()
    return parts.join(change(pages.root.pack()), pages.pack_pages())


def field_at(name: str, field: str, start: int = 0, number: int = 0) -> int:
    """Absolute offset of a field of a structure at `start`; of its given number if it has several."""
    place = place_of(name, field)
    return start + place.offset + (number * place.size // place.numbers if place.numbers else 0)


def header_with(**numbers: Any) -> Changes:
    """A change of header fields."""
    return {f"header.{name}": number for name, number in numbers.items()}


def entry_with(kind: int, layer: int = 1, **fields: Any) -> Change:
    """A change of fields of the entry of the first block of `kind` in a layer: values, or functions of those there."""

    def change(parts: Parts) -> None:
        row = parts.row(kind, layer)
        parts.entries[row] = edit(parts.entries[row], fields)

    return change


def block_added(payload: bytes = b"?", **entry: int) -> Change:
    """One more block, as :meth:`Parts.add`."""
    return lambda parts: parts.add(payload, **entry)


def flip_bits(data: bytes, offset: int, mask: int = 1) -> bytes:
    """The file with some bits of one byte inverted."""
    return data[:offset] + bytes([data[offset] ^ mask]) + data[offset + 1 :]
