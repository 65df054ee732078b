"""The directory page by page: only what is needed is read, in few requests, and is what reading all gives."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest

from conformance.surgery.parts import flip_bits
from scarfmt.container.file import Container, Entry, encode_front, read_header
from scarfmt.container.paged import AT_ONCE_BYTES
from scarfmt.container.schema import ENTRY_DTYPE, NO_TILE, TILE_DTYPE, BlockKind, Stream
from scarfmt.container.source import BytesSource
from scarfmt.errors import Malformed
from tests.samples.codec_samples import refuses
from tests.samples.container_samples import FIELDS

LAYERS, TILES, PAGE_BITS = 3, 20000, 8
PAGE = 1 << PAGE_BITS


class Scene(NamedTuple):
    """A front without blocks behind it, and what it was made of."""

    front: bytes
    tiles: np.ndarray
    directory: np.ndarray


class Sparse(BytesSource):
    """A file whose blocks are all zeros and take no memory."""

    def __init__(self, front: bytes) -> None:
        super().__init__(front)
        self.size = read_header(BytesSource(front), allow_truncated=True).file_length


@cache
def scene() -> Scene:
    """20,000 tiles of three layers; of layer 2 only the first 3,000 have blocks."""
    random = np.random.default_rng(7)
    tiles = np.zeros(TILES, TILE_DTYPE)
    tiles["depth"] = 8
    tiles["shift"] = random.integers(0, 3, TILES)
    tiles["prefix"] = np.sort(random.choice(1 << 24, TILES, replace=False))
    parts = []
    for layer in range(1, LAYERS + 1):
        models, blocks = np.zeros(2, ENTRY_DTYPE), np.zeros(3000 if layer == 2 else TILES, ENTRY_DTYPE)
        models["kind"], models["flags"], models["length"], models["tile"] = [1, 65], [1, 2], [90, 700], NO_TILE
        blocks["kind"], blocks["flags"], blocks["tile"] = BlockKind.TILE, 1, np.arange(len(blocks))
        blocks["length"], blocks["count"] = random.integers(1, 9000, len(blocks)), random.integers(0, 900, len(blocks))
        blocks["crc32"] = random.integers(0, 1 << 32, len(blocks))
        rows = np.concatenate([models[:1], blocks, models[1:]])
        rows["layer"] = layer
        parts.append(rows)
    directory = np.concatenate(parts)
    front = _front_of(directory, tiles)
    starts = np.cumsum(directory["length"], dtype=np.int64) - directory["length"]
    directory["offset"] = len(front) + starts
    return Scene(front, tiles, directory)


def opened() -> tuple[Container, Sparse]:
    """The scene, its header read."""
    source = Sparse(scene().front)
    return Container(source), source


def test_all_of_it_is_what_was_written() -> None:
    """Tables, objects and offsets."""
    container, _ = opened()
    assert (container.tile_table == scene().tiles).all()
    assert (container.directory == scene().directory).all()
    assert len(container.entries) == len(scene().directory)
    assert container.tiles[77] == container.tile(77)
    for layer in range(1, LAYERS + 1):
        assert (container.rows(layer) == scene().directory[scene().directory["layer"] == layer]).all()


def test_loading_all_of_it_is_one_request() -> None:
    """After that for the header; nothing is read twice."""
    container, source = opened()
    container.load()
    assert (source.reads, source.bytes_read) == (2, 2280 + len(scene().front) - container.header.header_length)
    _ = container.directory, container.tile_table
    assert source.reads == 2


def test_a_small_directory_is_one_request_whatever_is_asked_of_it() -> None:
    """Asking for its parts would take longer than they do."""
    rows = scene().directory
    few = rows[(rows["tile"] == NO_TILE) | (rows["tile"] < 8 * PAGE)]
    source = Sparse(_front_of(few, scene().tiles[: 8 * PAGE]))
    container = Container(source)
    assert container.header.data_offset < AT_ONCE_BYTES
    for tile in (0, 2000, 8 * PAGE - 1):
        assert container.find(BlockKind.TILE, 1, tile) is not None
    assert source.reads == 2


def _front_of(rows: np.ndarray, tiles: np.ndarray, page_bits: int = PAGE_BITS) -> bytes:
    """The front of some tiles and of rows of the directory."""
    counts, streams, anchors = [], [], 0
    for layer in range(1, LAYERS + 1):
        blocks = rows[(rows["layer"] == layer) & (rows["kind"] == BlockKind.TILE)]
        anchors += int(blocks["count"].sum())
        counts.append((anchors, anchors))
        streams.append([0] * len(Stream))
        streams[-1][Stream.MODELS], streams[-1][Stream.FRAMING] = 790, int(blocks["length"].sum())
    return encode_front(FIELDS, tiles, rows, counts, streams, page_bits)


def test_a_block_is_found_with_root_and_its_page() -> None:
    """A second block beside the first needs no further page."""
    container, source = opened()
    head, root = source.bytes_read, container.header.root_length
    tile = 50 * PAGE + 3
    entry = container.find(BlockKind.TILE, 3, tile)
    assert entry == _entry(3, tile)
    page = container.root.rows[container.root.row_page(3, 50)]
    assert source.bytes_read == head + root + int(page["row_bytes"])
    assert container.find(BlockKind.TILE, 3, tile + 200) == _entry(3, tile + 200)
    assert container.find(BlockKind.STREAMING, 2) is not None
    assert source.reads == 3
    assert container.tile(tile).prefix == scene().tiles["prefix"][tile]
    assert source.reads == 4


def _entry(layer: int, tile: int) -> Entry:
    rows = scene().directory
    row = rows[(rows["layer"] == layer) & (rows["tile"] == tile)][0]
    length, count, crc32 = int(row["length"]), int(row["count"]), int(row["crc32"])
    return Entry(BlockKind.TILE, 1, layer, tile, int(row["offset"]), length, count, crc32)


def test_fewer_layers_read_no_row_pages_of_later_ones() -> None:
    """Tile pages and row pages of the first layers lie side by side: header, ROOT, and one request."""
    container, source = opened()
    container.load(1)
    end = int(container.root.rows["offset"][container.root.rows["layer"] == 2][0])
    assert (source.reads, source.bytes_read) == (3, 2280 + end - container.header.header_length)
    counts = container.tile_counts(1, np.arange(TILES))
    rows = scene().directory
    assert (counts[:, 0] == rows["count"][(rows["layer"] == 1) & (rows["kind"] == BlockKind.TILE)]).all()
    assert source.reads == 3


def test_a_region_reads_the_pages_it_lies_in() -> None:
    """Each layer takes one request, because its pages follow one another; a layer without blocks there takes none."""
    container, source = opened()
    tiles = np.arange(20 * PAGE + 5, 23 * PAGE + 9)
    shuffled = np.random.default_rng(1).permutation(tiles)
    counts = container.tile_counts(LAYERS, shuffled)
    said, rows = container.root.pages[20:24], container.root.rows
    wanted = (rows["page"] >= 20) & (rows["page"] < 24)
    assert set(rows["layer"][wanted]) == {1, 3}
    size = int(said["tile_bytes"].sum()) + int(rows["row_bytes"][wanted].sum())
    assert (source.reads, source.bytes_read) == (2 + 3, 2280 + container.header.root_length + size)
    assert (container.tile_rows(tiles) == scene().tiles[tiles]).all()
    found = [[0 if e is None else e.count for e in container.tile_entries(tile, LAYERS)] for tile in shuffled.tolist()]
    assert counts.tolist() == found
    assert source.reads == 5


def test_pages_beside_damage_can_be_used() -> None:
    """A page that is not needed is not read, so it is not refused either (R-5.5-11)."""
    container, _ = opened()
    page = container.root.rows[container.root.row_page(1, 30)]
    container = Container(Sparse(flip_bits(scene().front, int(page["offset"]) + 9)))
    assert container.find(BlockKind.TILE, 1, 29 * PAGE) == _entry(1, 29 * PAGE)
    assert container.find(BlockKind.TILE, 3, 30 * PAGE) == _entry(3, 30 * PAGE)
    with pytest.raises(Malformed) as caught:
        container.find(BlockKind.TILE, 1, 30 * PAGE)
    assert (caught.value.refusal, caught.value.offset) == ("page-crc-mismatch", int(page["offset"]))
    refuses("page-crc-mismatch", lambda: container.load(1), kind=Malformed)
