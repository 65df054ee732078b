"""The places of ROOT, pages, blocks and checksums in a file, whatever their values are (SPEC §5.4, §5.5)."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass

from conformance.decoders.python.fields import Payload, Refused
from conformance.writer.pages import DEEPEST, TILE, Cube
from scarfmt.container.schema import NO_TILE, header_length

LAYER_COUNT, PAGE_BITS, TABLES, ROOT_CRC = 26, 31, 32, 96
"""Offsets in FILE_HEADER: of `layer_count`, `page_bits`, `tile_count` and `root_length` together, `root_crc32`."""
MAX_PAGE_BITS = 16


@dataclass(frozen=True)
class Summed:
    """Some bytes, and where their CRC-32 is."""

    start: int
    past: int
    crc_at: int

    def seal(self, data: bytearray) -> None:
        """Make the checksum right."""
        struct.pack_into("<I", data, self.crc_at, zlib.crc32(data[self.start : self.past]))


@dataclass(frozen=True)
class Found:
    """A block that ROOT or a row page lists."""

    kind: int
    flags: int
    layer: int
    tile: int
    count: int
    place: Summed


@dataclass(frozen=True)
class _Listed:
    """The fields of an entry that are read before the place of its block is known."""

    kind: int
    flags: int
    tile: int
    length: int
    count: int
    crc_at: int


class Front:
    """The front of a file.

    Attributes:
        root: ROOT.
        tile_pages, row_pages: pages.
        blocks: in file order.

    Raises:
        ValueError: the file is damaged where it says how long something is.
    """

    def __init__(self, data: bytes) -> None:
        if len(data) < header_length(1) or data[PAGE_BITS] > MAX_PAGE_BITS:
            raise ValueError("no header, or no pages")
        self._data, self._layers, self._size = data, data[LAYER_COUNT], 1 << data[PAGE_BITS]
        self._tile_count, size = struct.unpack_from("<II", data, TABLES)
        start = header_length(self._layers)
        self.root = Summed(start, start + size, ROOT_CRC)
        try:
            self._read(Payload(data[: self.root.past]))
        except (Refused, struct.error) as error:
            raise ValueError("a number of ROOT or of a page is cut or too long") from error

    def _read(self, root: Payload) -> None:
        root.at = self.root.start
        models = [list(_models(root)) for _ in range(self._layers)]
        self.bases: list[int] = []
        self.tile_pages: list[Summed] = []
        sizes: list[list[tuple[int, int]]] = []
        tile_sizes = []
        for _ in range(-(-self._tile_count // self._size)):
            self.bases.append((self.bases[-1] if self.bases else 0) + root.varint(63))
            tile_sizes.append((root.varint(32), _skipped(root)))
            sizes.append([_row_size(root) for _ in range(self._layers)])
        at = self.root.past
        for length, crc_at in tile_sizes:
            self.tile_pages.append(Summed(at, at + length, crc_at))
            at += length
        self.row_pages: list[Summed] = []
        rows: list[list[_Listed]] = []
        for layer in range(self._layers):
            rows.append([])
            for number, (length, crc_at) in enumerate(page[layer] for page in sizes):
                if length:
                    self.row_pages.append(Summed(at, at + length, crc_at))
                    rows[-1] += self._rows(self.row_pages[-1], number)
                    at += length
        self.blocks = list(_placed(models, rows, at))

    def _tiles_of(self, page: int) -> range:
        return range(page * self._size, min((page + 1) * self._size, self._tile_count))

    def _rows(self, page: Summed, number: int) -> list[_Listed]:
        reader = Payload(self._data[: page.past])
        reader.at = page.start
        lengths = [(tile, reader.varint(53)) for tile in self._tiles_of(number)]
        there = [(tile, length) for tile, length in lengths if length]
        counts = [reader.varint(32) for _ in there]
        return [
            _Listed(TILE, 1, tile, length, count, _skipped(reader))
            for (tile, length), count in zip(there, counts, strict=True)
        ]

    def cubes(self) -> list[Cube]:
        """The tiles.

        Raises:
            ValueError: a tile page is damaged.
        """
        out: list[Cube] = []
        for number, page in enumerate(self.tile_pages):
            reader, n = Payload(self._data[: page.past]), len(self._tiles_of(number))
            reader.at, past = page.start, self.bases[number]
            try:
                depths, shifts = reader.take(n), reader.take(n)
                gaps = [reader.varint(63) for _ in range(n)]
            except Refused as error:
                raise ValueError("a tile page is cut") from error
            if max(depths) > DEEPEST:
                raise ValueError("a tile is too deep")
            for depth, shift, gap in zip(depths, shifts, gaps, strict=True):
                free = 3 * (DEEPEST - depth)
                prefix = -(-past >> free) + gap
                past = prefix + 1 << free
                out.append((depth, shift, prefix))
        return out


def _skipped(reader: Payload) -> int:
    """The place of a CRC, which is not read."""
    reader.take(4)
    return reader.at - 4


def _models(root: Payload) -> Iterator[_Listed]:
    for _ in range(root.varint(8)):
        kind, flags = root.take(2)
        yield _Listed(kind, flags, NO_TILE, root.varint(53), root.varint(32), _skipped(root))


def _row_size(root: Payload) -> tuple[int, int]:
    """Bytes of a row page, and where their CRC is."""
    size = root.varint(32)
    if not size:
        return 0, 0
    crc_at = _skipped(root)
    root.varint(53)
    root.varint(53)
    return size, crc_at


def _placed(models: list[list[_Listed]], rows: list[list[_Listed]], at: int) -> Iterator[Found]:
    for layer, (listed, tiles) in enumerate(zip(models, rows, strict=True), start=1):
        before = [row for row in listed if row.kind < TILE]
        for row in (*before, *tiles, *(row for row in listed if row.kind >= TILE)):
            yield Found(row.kind, row.flags, layer, row.tile, row.count, Summed(at, at + row.length, row.crc_at))
            at += row.length
