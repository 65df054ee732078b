"""Header, ROOT, tile pages and row pages (SPEC §5.1 to §5.5): which tiles there are, and where every block lies.

Checks are in the order of lists 1 and 2 of §12.2.
"""

from __future__ import annotations

import math
import struct
import zlib
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

from conformance.decoders.python.fields import Payload, Refused, require

NO_TILE = 0xFFFFFFFF
LAYER, TABLES, CODEBOOKS, DECODER_MLP, SCENE_MLP, HASH_GRID, ENTROPY_NETWORK, PREDICTORS = range(1, 9)
THUMBNAIL, TILE, METADATA = 15, 16, 64
DEEPEST = 21
EXACT = (1 << 53) - 1


class Limits(NamedTuple):
    """What a reader allows (§13.2); `whole`: no source shorter than the file is accepted (R-5.3-8)."""

    whole: bool = True
    tiles: int = 1 << 20
    root: int = 1 << 24
    anchors: int = 1 << 31
    gaussians: int = 1 << 36
    block: int = 1 << 28
    tile_anchors: int = 1 << 16
    anchors_per_byte: int = 1
    slots_per_byte: int = 8
    numbers_per_byte: int = 2
    work_per_byte: int = 1 << 17


LIMITS = Limits()

Layout = tuple[tuple[str, str, int], ...]

FILE_HEADER: Layout = (
    ("signature", "bytes", 9),
    ("major", "u8", 1),
    ("minor", "u8", 1),
    ("render_model", "u8", 1),
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
_CODES = {"u8": "B", "u16": "H", "u32": "I", "u64": "Q", "f64": "d", "bytes": "s"}


def size_of(layout: Layout) -> int:
    """Bytes of a structure."""
    return sum(struct.calcsize(f"<{count}{_CODES[kind]}") for _, kind, count in layout)


def numbers_at(data: bytes, at: int, layout: Layout) -> dict[str, Any]:
    """The fields of a structure at a byte offset, by name; several numbers as a tuple."""
    out: dict[str, Any] = {}
    for name, kind, count in layout:
        code = f"<{count}{_CODES[kind]}"
        found = struct.unpack_from(code, data, at)
        out[name] = found if len(found) > 1 else found[0]
        at += struct.calcsize(code)
    return out


def read_header(data: bytes, limits: Limits = LIMITS) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """The fields of the header and of each layer summary, checked."""
    start = data[:9]
    if start != SIGNATURE:
        require(len(start) == 9 or not SIGNATURE.startswith(start), "truncated-header")
        raise Refused("damaged-signature" if b"SCAR" in data[:8] else "bad-signature")
    require(len(data) >= 11, "truncated-header")
    require(data[9:11] == b"\0\3", "unsupported-version")
    require(len(data) >= 16, "truncated-header")
    size = int.from_bytes(data[12:16], "little")
    require(size in range(240, 104 + 136 * 16 + 1, 136), "bad-header-length")
    require(len(data) >= size, "truncated-header")
    require(zlib.crc32(data[: size - 4]) == int.from_bytes(data[size - 4 : size], "little"), "header-crc-mismatch")
    h = numbers_at(data, 0, FILE_HEADER)
    _check_header(h, limits)
    layers = [numbers_at(data, at, LAYER_SUMMARY) for at in range(100, size - 4, 136)]
    _check_layers(h, layers)
    require(len(data) <= h["file_length"], "trailing-bytes")
    require(len(data) >= h["file_length"] or not limits.whole, "truncated-file")
    return h, layers


def _check_header(h: dict[str, Any], limits: Limits) -> None:
    explicit, anchors, length = h["profile"] == 0, h["anchor_count"], h["file_length"]
    slots = anchors * h["slots"]
    farthest = max(map(abs, h["origin"])) + h["voxel"] * 2.0 ** (h["lattice_bits"] + 1)
    for holds, refusal in (
        (h["render_model"] <= 2, "bad-reserved"),
        (length <= EXACT, "bad-file-length"),
        (h["profile"] <= 1, "bad-profile"),
        (h["sh_degree"] <= (3 if explicit else 0), "bad-sh-degree"),
        (104 + 136 * h["layer_count"] == h["header_length"], "bad-layer-count"),
        (1 <= h["slots"] <= (1 if explicit else 32), "bad-slots"),
        (1 <= h["lattice_bits"] <= 32, "bad-lattice-bits"),
        (h["coordinate_frame"] <= 2, "bad-coordinate-frame"),
        (h["colour_space"] <= 2, "bad-colour-space"),
        (h["page_bits"] <= 16, "bad-page-bits"),
        (all(map(math.isfinite, h["origin"])), "bad-origin"),
        (math.isfinite(h["voxel"]) and h["voxel"] > 0, "bad-voxel"),
        (math.isfinite(farthest), "bad-voxel"),
        (h["source_count"] <= EXACT, "bad-source-count"),
        (h["tile_count"] <= limits.tiles, "limit-tiles"),
        (anchors <= limits.anchors, "limit-anchors"),
        (h["gaussian_count"] <= limits.gaussians, "limit-gaussians"),
        (h["root_length"] <= limits.root, "limit-root"),
        (anchors <= (1 << 16) + limits.anchors_per_byte * length, "limit-expansion"),
        (slots <= (1 << 19) + limits.slots_per_byte * length, "limit-expansion"),
    ):
        require(holds, refusal)


def _check_layers(h: dict[str, Any], layers: list[dict[str, Any]]) -> None:
    explicit, anchors, gaussians = h["profile"] == 0, 0, 0
    end = None
    for layer in layers:
        require(layer["anchor_count"] >= anchors and layer["gaussian_count"] >= gaussians, "layer-counts")
        anchors, gaussians = layer["anchor_count"], layer["gaussian_count"]
        require(gaussians == anchors if explicit else gaussians <= anchors * h["slots"], "layer-counts")
        require(sum(layer["stream_bytes"]) == layer["byte_count"], "layer-bytes")
        begin = layer["end_offset"] - layer["byte_count"]
        require(begin >= h["header_length"] + h["root_length"] if end is None else begin == end, "layer-offset")
        end = layer["end_offset"]
    require((anchors, gaussians) == (h["anchor_count"], h["gaussian_count"]), "layer-counts")
    require(h["file_length"] == end, "bad-file-length")


class Tile(NamedTuple):
    """A cube of the lattice."""

    depth: int
    shift: int
    prefix: int


@dataclass(frozen=True)
class Entry:
    """The place of a block; `tile` is NO_TILE for a block that belongs to no tile."""

    kind: int
    flags: int
    layer: int
    tile: int
    offset: int
    length: int
    count: int
    crc32: int


class Span(NamedTuple):
    """A page: where its bytes are in the file, and their CRC-32."""

    start: int
    past: int
    crc32: int


class _Rows(NamedTuple):
    """The fields of a row page in ROOT."""

    size: int
    crc32: int
    block_bytes: int
    anchors: int


class _Page(NamedTuple):
    """The fields of a page in ROOT: the Morton code at which it begins, its tiles, its rows in every layer."""

    base: int
    size: int
    crc32: int
    rows: list[_Rows]


class Root:
    """The content of ROOT, and the place of every page.

    Args:
        data: a file whose header is sound.
    """

    def __init__(self, data: bytes, limits: Limits = LIMITS) -> None:
        self.limits = limits
        h = numbers_at(data, 0, FILE_HEADER)
        self.layer_count, self.lattice_bits = h["layer_count"], h["lattice_bits"]
        self.page_bits, self.tile_count = h["page_bits"], h["tile_count"]
        start, past = h["header_length"], h["header_length"] + h["root_length"]
        root = data[start:past]
        require(zlib.crc32(root) == h["root_crc32"], "directory-crc-mismatch")
        reader = Payload(root)
        self.models = [_models(reader) for _ in range(self.layer_count)]
        self.pages: list[_Page] = []
        for _ in range(-(-self.tile_count >> self.page_bits)):
            base = self.pages[-1].base if self.pages else 0
            base += reader.varint(63)
            tile_bytes, tile_crc = reader.varint(32), reader.fields("I")[0]
            self.pages.append(_Page(base, tile_bytes, tile_crc, [_rows(reader) for _ in range(self.layer_count)]))
        reader.finish()
        self._place(past)

    def _place(self, at: int) -> None:
        """The places of pages: `tile_pages` by page; `row_pages` by layer, from 1, and page; `blocks`, the end of all
        pages."""
        self.tile_pages: list[Span] = []
        for page in self.pages:
            self.tile_pages.append(Span(at, at + page.size, page.crc32))
            at += page.size
        self.row_pages: dict[tuple[int, int], Span] = {}
        for layer in range(1, self.layer_count + 1):
            for number, page in enumerate(self.pages):
                rows = page.rows[layer - 1]
                if rows.size:
                    self.row_pages[layer, number] = Span(at, at + rows.size, rows.crc32)
                    at += rows.size
        self.blocks = at

    def check(self, h: dict[str, Any], layers: list[dict[str, Any]]) -> None:
        """Lines 2.4 to 2.16 of §12.2: what ROOT says agrees with itself and with the header."""
        rows = [(layer, *row) for layer, models in enumerate(self.models, start=1) for row in models]
        for holds, refusal in (
            (all(kind not in (0, TILE) for _, kind, *_ in rows), "entry-kind"),
            (all(flags in _flags(kind) for _, kind, flags, *_ in rows), "entry-flags"),
            (all(layer == 1 for layer, kind, *_ in rows if kind == METADATA), "entry-layer"),
            (all(a[0] < b[0] for models in self.models for a, b in pairwise(models)), "entry-order"),
            (all(1 <= length <= h["file_length"] for _, _, _, length, *_ in rows), "entry-length"),
            (all(length <= self.limits.block for _, _, _, length, *_ in rows), "limit-block-bytes"),
            (all(count == 0 for _, kind, _, _, count, _ in rows if kind == METADATA), "entry-count"),
            (all(a.base < b.base for a, b in pairwise(self.pages)), "tile-order"),
            (all(page.base < 1 << 63 for page in self.pages), "tile-order"),
            (all(map(self._sizes_fit, range(len(self.pages)))), "page-length"),
            (all(row.block_bytes > 0 for page in self.pages for row in page.rows if row.size), "page-sums"),
        ):
            require(holds, refusal)
        before = 0
        for layer, models, number in zip(layers, self.models, range(self.layer_count), strict=True):
            lengths = sum(length for _, _, length, _, _ in models)
            tiles = sum(page.rows[number].block_bytes for page in self.pages)
            found = lengths == layer["stream_bytes"][0] and lengths + tiles == layer["byte_count"]
            require(found, "layer-directory-bytes")
            anchors = sum(page.rows[number].anchors for page in self.pages)
            require(anchors == layer["anchor_count"] - before, "layer-directory-anchors")
            before = layer["anchor_count"]
        require(self.blocks == layers[0]["end_offset"] - layers[0]["byte_count"], "directory-length")
        known = (*range(LAYER, PREDICTORS + 1), METADATA)
        require(all(kind in known or not flags & 1 for _, kind, flags, *_ in rows), "unknown-critical-block")

    def _sizes_fit(self, number: int) -> bool:
        n, page = self.tiles_in(number), self.pages[number]
        rows = all(row.size == 0 or n + 5 <= row.size <= 17 * n for row in page.rows)
        return 3 * n <= page.size <= 11 * n and rows

    def tiles_in(self, number: int) -> int:
        """How many tiles a page has."""
        size = 1 << self.page_bits
        return int(min(size, self.tile_count - number * size))

    def tiles(self, data: bytes, number: int) -> list[Tile]:
        """The tiles of a page."""
        reader = _open(data, self.tile_pages[number])
        n = self.tiles_in(number)
        depths, shifts, gaps = reader.take(n), reader.take(n), [reader.varint(63) for _ in range(n)]
        reader.finish()
        require(max(depths) <= DEEPEST, "tile-depth")
        require(max(shifts) <= 31, "tile-shift")
        local = [self.lattice_bits - depth - shift for depth, shift in zip(depths, shifts, strict=True)]
        require(all(0 <= b <= 21 for b in local), "tile-local-bits")
        out, past = [], self.pages[number].base
        for depth, shift, gap in zip(depths, shifts, gaps, strict=True):
            free = 3 * (DEEPEST - depth)
            prefix = -(-past >> free) + gap
            past = prefix + 1 << free
            out.append(Tile(depth, shift, prefix))
        require(all(tile.prefix < 1 << 3 * tile.depth for tile in out), "tile-prefix")
        first = out[0].prefix << 3 * (DEEPEST - out[0].depth)
        following = [page.base for page in self.pages[number + 1 : number + 2]]
        require(first == self.pages[number].base and all(past <= base for base in following), "tile-order")
        return out

    def rows(self, data: bytes, layer: int, number: int) -> list[tuple[int, int, int, int]]:
        """Tile, length, count and CRC-32 of the TILE blocks of a page in a layer."""
        if (layer, number) not in self.row_pages:
            return []
        reader = _open(data, self.row_pages[layer, number])
        lengths = [reader.varint(53) for _ in range(self.tiles_in(number))]
        there = [tile for tile, length in enumerate(lengths) if length]
        counts = [reader.varint(32) for _ in there]
        crcs = reader.fields(f"{len(there)}I")
        reader.finish()
        require(max(lengths) <= self.limits.block, "limit-block-bytes")
        require(max(counts, default=0) <= self.limits.tile_anchors, "limit-tile-anchors")
        said = self.pages[number].rows[layer - 1]
        require((sum(lengths), sum(counts)) == (said.block_bytes, said.anchors), "page-sums")
        first = number << self.page_bits
        return [(first + t, lengths[t], count, crc) for t, count, crc in zip(there, counts, crcs, strict=True)]


def _flags(kind: int) -> tuple[int, ...]:
    """The flags that a kind of block may have (§16.4)."""
    if kind < THUMBNAIL:
        return (1,)
    return (2,) if kind in (THUMBNAIL, METADATA) else (0, 1, 2)


def _models(reader: Payload) -> list[tuple[int, int, int, int, int]]:
    """Kind, flags, length, count and CRC-32 of the blocks of a layer that belong to no tile."""
    rows = reader.varint(8)
    return [(*reader.fields("BB"), reader.varint(53), reader.varint(32), *reader.fields("I")) for _ in range(rows)]


def _rows(reader: Payload) -> _Rows:
    size = reader.varint(32)
    if size == 0:
        return _Rows(0, 0, 0, 0)
    return _Rows(size, reader.fields("I")[0], reader.varint(53), reader.varint(53))


def _open(data: bytes, page: Span) -> Payload:
    body = data[page.start : page.past]
    require(zlib.crc32(body) == page.crc32, "page-crc-mismatch")
    return Payload(body)


def read_tiles(data: bytes, root: Root) -> list[Tile]:
    """All tiles."""
    return [tile for number in range(len(root.pages)) for tile in root.tiles(data, number)]


def read_entries(data: bytes, root: Root) -> list[Entry]:
    """An entry for every block, in the order in which they lie: by layer, kind, tile."""
    out: list[Entry] = []
    at = root.blocks
    for layer, models in enumerate(root.models, start=1):
        rows = [(kind, flags, NO_TILE, *row) for kind, flags, *row in models if kind < TILE]
        for number in range(len(root.pages)):
            rows += [(TILE, 1, *row) for row in root.rows(data, layer, number)]
        rows += [(kind, flags, NO_TILE, *row) for kind, flags, *row in models if kind > TILE]
        for kind, flags, tile, length, count, crc in rows:
            out.append(Entry(kind, flags, layer, tile, at, length, count, crc))
            at += length
    return out
