"""The front of a file taken apart, to be changed and put together again with right lengths and checksums (SPEC §5).

Written from SPEC, not from the package: what both agree on is right.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

from scarfmt.container.schema import FILE_HEADER_SIZE, LAYER_SUMMARY_SIZE


def varint(value: int) -> bytes:
    """LEB128."""
    out = b""
    while value >= 0x80:
        out += bytes([value & 0x7F | 0x80])
        value >>= 7
    return out + bytes([value])


class Cursor:
    """Reads a sound structure."""

    def __init__(self, data: bytes, at: int) -> None:
        self.data, self.at = data, at

    def varint(self) -> int:
        value = shift = 0
        while True:
            byte = self.data[self.at]
            self.at, value, shift = self.at + 1, value | (byte & 0x7F) << shift, shift + 7
            if byte < 0x80:
                return value

    def number(self, size: int) -> int:
        self.at += size
        return int.from_bytes(self.data[self.at - size : self.at], "little")


@dataclass
class Model:
    """An entry of ROOT."""

    kind: int
    flags: int
    length: int
    count: int
    crc32: int


@dataclass
class Rows:
    """A row page: lengths of all tiles, counts and checksums of those with a block; None is worked out.

    `raw` stands for the bytes of the page."""

    lengths: list[int]
    counts: list[int]
    crc32: list[int]
    row_bytes: int | None = None
    row_crc32: int | None = None
    block_bytes: int | None = None
    anchors: int | None = None
    raw: bytes | None = None

    def data(self) -> bytes:
        """The page."""
        if self.raw is not None:
            return self.raw
        numbers = b"".join(map(varint, [*self.lengths, *self.counts]))
        return numbers + struct.pack(f"<{len(self.crc32)}I", *self.crc32)


@dataclass
class Page:
    """A page of tiles, and its rows by layer; None is worked out."""

    base_gap: int
    depth: list[int]
    shift: list[int]
    gap: list[int]
    rows: list[Rows | None]
    tile_bytes: int | None = None
    tile_crc32: int | None = None
    raw: bytes | None = None

    def data(self) -> bytes:
        """The tile page."""
        if self.raw is not None:
            return self.raw
        return bytes(self.depth) + bytes(self.shift) + b"".join(map(varint, self.gap))


@dataclass
class Front:
    """A file: header without its checksum, entries of ROOT by layer, pages, and the bytes of all blocks.

    Attributes:
        after_root, after_page, after_rows: put behind ROOT, tile page 0, the first row page; counted as part of them.
        before_blocks: bytes between the last page and the first block, counted in D alone.
    """

    header: bytearray
    models: list[list[Model]]
    pages: list[Page]
    body: bytes
    after_root: bytes = b""
    after_page: bytes = b""
    after_rows: bytes = b""
    before_blocks: bytes = b""
    root_crc32: int | None = None

    @classmethod
    def of(cls, data: bytes) -> Front:
        """The parts of a sound file."""
        layers, page_bits = data[26], data[31]
        tiles = int.from_bytes(data[32:36], "little")
        end = FILE_HEADER_SIZE + layers * LAYER_SUMMARY_SIZE
        at = Cursor(data, end + 4)
        models = [
            [
                Model(at.number(1), at.number(1), at.varint(), at.varint(), at.number(4)) for _ in range(at.varint())
            ]
            for _ in range(layers)
        ]
        heads = []
        for start in range(0, tiles, 1 << page_bits):
            count = min(1 << page_bits, tiles - start)
            gap, _, _ = at.varint(), at.varint(), at.number(4)
            present = []
            for _ in range(layers):
                present.append(at.varint() > 0)
                if present[-1]:
                    _ = at.number(4), at.varint(), at.varint()
            heads.append((count, gap, present))
        pages = []
        for count, gap, _ in heads:
            depth, shift = [at.number(1) for _ in range(count)], [at.number(1) for _ in range(count)]
            pages.append(Page(gap, depth, shift, [at.varint() for _ in range(count)], []))
        for layer in range(layers):
            for page, (count, _, present) in zip(pages, heads, strict=True):
                page.rows.append(_rows(at, count) if present[layer] else None)
        return cls(bytearray(data[:end]), models, pages, data[at.at :])

    def root(self) -> bytes:
        """ROOT."""
        out = b""
        for models in self.models:
            out += varint(len(models))
            for model in models:
                out += bytes([model.kind, model.flags]) + varint(model.length) + varint(model.count)
                out += struct.pack("<I", model.crc32)
        for number, page in enumerate(self.pages):
            out += varint(page.base_gap) + _said(self._tile_data(number), page.tile_bytes, page.tile_crc32)
            for rows in page.rows:
                if rows is None:
                    out += b"\0"
                    continue
                out += _said(self._row_data(rows), rows.row_bytes, rows.row_crc32)
                out += varint(sum(rows.lengths) if rows.block_bytes is None else rows.block_bytes)
                out += varint(sum(rows.counts) if rows.anchors is None else rows.anchors)
        return out + self.after_root

    def _tile_data(self, page: int) -> bytes:
        return self.pages[page].data() + (b"" if page else self.after_page)

    def _row_data(self, rows: Rows) -> bytes:
        first = next((each for page in self.pages for each in page.rows if each is not None), None)
        return rows.data() + (self.after_rows if rows is first else b"")

    def bytes(self) -> bytes:
        """The file: lengths, offsets and checksums of the front worked out, unless they were given."""
        root = self.root()
        tile_pages = b"".join(map(self._tile_data, range(len(self.pages))))
        row_pages = b"".join(
            self._row_data(page.rows[layer])
            for layer in range(len(self.models))
            for page in self.pages
            if page.rows[layer] is not None
        )
        header = self.header.copy()
        directory = root + tile_pages + row_pages + self.before_blocks
        end = len(header) + 4 + len(directory)
        for start in range(FILE_HEADER_SIZE, len(header), LAYER_SUMMARY_SIZE):
            end += int.from_bytes(header[start + 16 : start + 24], "little")
            header[start + 24 : start + 32] = end.to_bytes(8, "little")
        header[16:24] = end.to_bytes(8, "little")
        header[36:40] = len(root).to_bytes(4, "little")
        header[96:100] = (zlib.crc32(root) if self.root_crc32 is None else self.root_crc32).to_bytes(4, "little")
        return bytes(header) + zlib.crc32(header).to_bytes(4, "little") + directory + self.body


def _rows(at: Cursor, count: int) -> Rows:
    lengths = [at.varint() for _ in range(count)]
    present = sum(length > 0 for length in lengths)
    return Rows(lengths, [at.varint() for _ in range(present)], [at.number(4) for _ in range(present)])


def _said(data: bytes, size: int | None, crc32: int | None) -> bytes:
    size = len(data) if size is None else size
    return varint(size) + struct.pack("<I", zlib.crc32(data) if crc32 is None else crc32)
