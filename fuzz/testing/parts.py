"""A file as its parts, to be changed and put together again with right lengths and checksums (SPEC §5).

Nothing is checked: any field may be made wrong. Only the parts of a file whose front is sound can be taken.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache

from conformance.writer.pages import Cube, ModelRow, Pages, TileRow, paged
from fuzz.testing.front import LAYER_COUNT, PAGE_BITS, ROOT_CRC, TABLES, Front
from scarfmt.container.schema import (
    CHECKSUM_SIZE,
    FILE_HEADER_SIZE,
    LAYER_SUMMARY_SIZE,
    SIGNATURE,
    STREAM_COUNT,
    SUBSTREAM_RECORD,
    BlockKind,
    Stream,
    header_length,
)

RECORD = struct.Struct("<BII")
_COUNTS = struct.Struct("<QQ")
_SUMMARY = struct.Struct(f"<{4 + STREAM_COUNT}Q")
RECORD_SIZE: int = SUBSTREAM_RECORD.sizeof()
_CRC = struct.Struct("<I")
# Offsets in FILE_HEADER of what is computed, besides those of the front.
_HEADER_LENGTH, _FILE_LENGTH, _ANCHORS = 12, 16, 40


@dataclass
class Part:
    """A block and its entry; length and crc32 are computed."""

    kind: int
    flags: int
    layer: int
    tile: int
    count: int
    payload: bytes


@dataclass
class Parts:
    """A file taken apart.

    Attributes:
        header: FILE_HEADER; lengths, counts and checksum in it are computed.
        gaussians: per layer, cumulative Gaussians as the file declared them.
        tiles: depth, shift and prefix of each.
        blocks: in file order.
    """

    header: bytes
    gaussians: list[int]
    tiles: list[Cube]
    blocks: list[Part] = field(default_factory=list)

    def copy(self) -> Parts:
        """A copy whose lists and blocks may be changed."""
        return Parts(self.header, list(self.gaussians), list(self.tiles), [replace(block) for block in self.blocks])

    def of_tile(self, block: Part) -> bool:
        """Whether a row page lists a block; ROOT lists the others, TILE blocks of a tile there is not among them."""
        return block.kind == BlockKind.TILE and block.tile < len(self.tiles)

    def settle(self) -> None:
        """Put the blocks in file order: by layer, those of tiles by tile, between others of lower and higher kinds.

        Of two TILE blocks of one layer and tile the second stays, and so does a block of a layer that there is.
        """
        kept: dict[object, Part] = {}
        for number, block in enumerate(self.blocks):
            if 1 <= block.layer <= len(self.gaussians):
                kept[(block.layer, block.tile) if self.of_tile(block) else number] = block
        self.blocks = sorted(kept.values(), key=self._place)

    def _place(self, block: Part) -> tuple[int, int, int]:
        if self.of_tile(block):
            return block.layer, 1, block.tile
        return block.layer, 0 if block.kind < BlockKind.TILE else 2, 0


@lru_cache(maxsize=512)
def _parts_of(data: bytes) -> Parts:
    front = Front(data)
    blocks = [
        Part(b.kind, b.flags, b.layer, b.tile, b.count, data[b.place.start : b.place.past]) for b in front.blocks
    ]
    starts = range(FILE_HEADER_SIZE, front.root.start - CHECKSUM_SIZE, LAYER_SUMMARY_SIZE)
    gaussians = [_COUNTS.unpack_from(data, start)[1] for start in starts]
    return Parts(data[:FILE_HEADER_SIZE], gaussians, front.cubes(), blocks)


def take_apart(data: bytes) -> Parts:
    """The parts of a sound file, the caller's own.

    Raises:
        ValueError: ROOT or a page is damaged.
    """
    return _parts_of(data).copy()


def put_together(
    parts: Parts, change: Callable[[Pages], object] | None = None, change_root: Callable[[bytes], bytes] = bytes
) -> bytes:
    """A file of these parts: counts of anchors, lengths, offsets and checksums follow from them.

    Args:
        change: of numbers in ROOT and pages; the lengths and checksums of pages are made right before it.
        change_root: of the bytes of ROOT.

    Raises:
        ValueError: tiles that no page can say.
    """
    parts.settle()
    layers = len(parts.gaussians)
    streams = [[0] * STREAM_COUNT for _ in range(layers)]
    new = [0] * layers
    for block in parts.blocks:
        _count(streams[block.layer - 1], block)
        new[block.layer - 1] += block.count if parts.of_tile(block) else 0
    pages = _pages(parts)
    if change is not None:
        change(pages)
    root = change_root(pages.root.packed())
    return _front(parts, streams, new, root, pages.packed_pages()) + b"".join(block.payload for block in parts.blocks)


def _pages(parts: Parts) -> Pages:
    models: list[list[ModelRow]] = [[] for _ in parts.gaussians]
    rows = []
    for block in parts.blocks:
        size, crc = len(block.payload), zlib.crc32(block.payload)
        if parts.of_tile(block):
            rows.append(TileRow(block.layer, block.tile, size, block.count, crc))
        else:
            models[block.layer - 1].append(ModelRow(block.kind, block.flags, size, block.count, crc))
    return paged(parts.tiles, models, rows, parts.header[PAGE_BITS])


def _count(streams: list[int], block: Part) -> None:
    """Add a block to the bytes per stream kind of its layer."""
    if block.kind != BlockKind.TILE:
        streams[Stream.MODELS] += len(block.payload)
        return
    rest = len(block.payload)
    for kind, length, _ in records(block.payload):
        if Stream.MODELS < kind < Stream.FRAMING and length <= rest:
            streams[kind] += length
            rest -= length
    streams[Stream.FRAMING] += rest


def records(payload: bytes) -> list[tuple[int, int, int]]:
    """(stream, length, crc32) of the sub-stream records that a TILE block has room for."""
    count = min(payload[0], (len(payload) - 1) // RECORD_SIZE) if payload else 0
    return [RECORD.unpack_from(payload, 1 + RECORD_SIZE * index) for index in range(count)]


def _front(parts: Parts, streams: list[list[int]], new: list[int], root: bytes, pages: bytes) -> bytes:
    layers = len(streams)
    header = bytearray(parts.header)
    explicit, slots = header[24] == 0, header[27]
    summaries, anchors, gaussians = [], 0, 0
    end = header_length(layers) + len(root) + len(pages)
    for counts, more, declared in zip(streams, new, parts.gaussians, strict=True):
        anchors += more
        gaussians = anchors if explicit else max(gaussians, min(declared, anchors * slots))
        size = sum(counts)
        end += size
        summaries.append(_SUMMARY.pack(anchors, gaussians, size, end, *counts))
    struct.pack_into("<IQ", header, _HEADER_LENGTH, header_length(layers), end)
    header[LAYER_COUNT] = layers
    struct.pack_into("<II", header, TABLES, len(parts.tiles), len(root))
    struct.pack_into("<QQ", header, _ANCHORS, anchors, gaussians)
    _CRC.pack_into(header, ROOT_CRC, zlib.crc32(root))
    front = bytes(header) + b"".join(summaries)
    return front + _CRC.pack(zlib.crc32(front)) + root + pages


def resealed_tile(payload: bytes) -> bytes:
    """A TILE block with all its checksums made right, as far as its table makes sense."""
    if not payload:
        return payload
    size = 1 + RECORD_SIZE * payload[0]
    if size + 4 > len(payload):
        return payload
    out = bytearray(payload)
    at = size + 4
    for start in range(1, size, RECORD_SIZE):
        length = RECORD.unpack_from(out, start)[1]
        _CRC.pack_into(out, start + RECORD_SIZE - 4, zlib.crc32(out[at : at + length]))
        at += length
    _CRC.pack_into(out, size, zlib.crc32(out[:size]))
    return bytes(out)


def resealed(data: bytes) -> bytes:
    """The file with the checksums of sub-streams, blocks, pages, ROOT and header made right where they can be found."""
    if len(data) < FILE_HEADER_SIZE + CHECKSUM_SIZE:
        return data
    out = bytearray(data)
    (length,) = struct.unpack_from("<I", out, _HEADER_LENGTH)
    if length == header_length(out[LAYER_COUNT]):
        _reseal_front(out)
    if FILE_HEADER_SIZE + CHECKSUM_SIZE <= length <= len(out):
        _CRC.pack_into(out, length - CHECKSUM_SIZE, zlib.crc32(out[: length - CHECKSUM_SIZE]))
    return bytes(out)


def _reseal_front(out: bytearray) -> None:
    try:
        front = Front(bytes(out))
    except ValueError:
        return
    for block in front.blocks:
        place = block.place
        if place.start < place.past <= len(out):
            if block.kind == BlockKind.TILE:
                out[place.start : place.past] = resealed_tile(bytes(out[place.start : place.past]))
            place.seal(out)
    for page in (*front.row_pages, *front.tile_pages, front.root):
        page.seal(out)


def is_file(data: bytes) -> bool:
    """Whether the bytes start like a file of this version: what :func:`take_apart` needs, and no more."""
    return len(data) >= header_length(1) and data.startswith(SIGNATURE)
