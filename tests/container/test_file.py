"""The container: round trips, every refusal, damage and truncation."""

from __future__ import annotations

import dataclasses
import math
import zlib
from collections.abc import Callable
from functools import partial

import pytest

from conformance.surgery.parts import flip_bits
from scarfmt.container.file import Block, Container, Tile, write_container
from scarfmt.container.header import header_length
from scarfmt.container.schema import Stream
from scarfmt.container.source import BytesSource
from scarfmt.errors import LimitExceeded, Malformed, ScarError, Truncated
from scarfmt.limits import FORMAT_LIMITS, FREE_ANCHORS, Limits
from tests.samples.codec_samples import refuses
from tests.samples.container_samples import COUNTS, FIELDS, TILES, edit, get, locate, sample_blocks, sample_file


def read_all(data: bytes, limits: Limits = FORMAT_LIMITS) -> list[bytes]:
    """Every block of a file, verified."""
    container = Container(BytesSource(data), limits=limits).load()
    return [block for _, block in container.read_blocks(container.entries)]


def refusal_of(data: bytes, error: type[ScarError], **options: Limits) -> ScarError:
    with pytest.raises(error) as caught:
        read_all(data, **options)
    assert type(caught.value) is error
    return caught.value


# ------------------------------------------------------------------------------------------------ round trips


def test_the_order_of_the_blocks_given_changes_nothing() -> None:
    assert write_container(FIELDS, TILES, sample_blocks()[::-1], COUNTS) == sample_file()


def test_opening_reads_the_header_and_the_directory_reads_itself() -> None:
    """The container is lazy: two reads bring everything but blocks; neighbours share a request."""
    source = BytesSource(sample_file())
    container = Container(source)
    assert source.reads == 1
    _ = container.tiles, container.entries
    assert source.reads == 2
    first_layer = [entry for entry in container.entries if entry.layer == 1]
    assert len(dict(container.read_blocks(first_layer))) == 5
    assert source.reads == 3
    scattered = [container.entries[0], container.entries[2], container.entries[3]]
    assert [e for e, _ in container.read_blocks(scattered)] == scattered
    assert source.reads == 5


def test_block_ranges_are_checked() -> None:
    """A sub-stream offset from an untrusted block cannot reach outside it."""
    container = Container(BytesSource(sample_file()))
    entry = container.entries[0]
    assert container.read_range(entry, 6, 5) == b"layer"
    for start, length in ((0, 12), (-1, 2), (5, -1), (12, 0)):
        refuses("block-range", partial(container.read_range, entry, start, length), kind=Malformed)


# --------------------------------------------------------------------------------------------------- refusals

BASE = sample_file(page_bits=1)
H, L = "FILE_HEADER", "LAYER_SUMMARY"


def reheaded(data: bytearray) -> bytearray:
    """`data` with the checksum of its header made right, and no other."""
    end = int.from_bytes(data[12:16], "little") - 4
    data[end : end + 4] = zlib.crc32(data[:end]).to_bytes(4, "little")
    return data


@pytest.mark.parametrize(("table", "row", "name", "value"), [(H, 0, "origin", math.nan), (L, 1, "end_offset", 1)])
def test_errors_point_at_the_broken_field(table: str, row: int, name: str, value: float) -> None:
    """The reported offset is where a hex editor finds the fault."""
    error = refusal_of(edit(BASE, table, row, name, value), Malformed)
    assert error.offset == locate(table, row, name)[0]
    assert name in str(error.field)


@pytest.mark.parametrize(
    ("table", "row", "name", "value", "limits", "refusal"),
    [
        (H, 0, "anchor_count", FREE_ANCHORS + 1, Limits(anchors_per_byte=0), "limit-expansion"),
        (H, 0, "render_model", 0, Limits(block_bytes=18), "limit-block-bytes"),
        (H, 0, "render_model", 0, Limits(tile_anchors=74), "limit-tile-anchors"),
        (H, 0, "render_model", 0, Limits(anchors=99), "limit-anchors"),
        (H, 0, "render_model", 0, Limits(root_bytes=20), "limit-root"),
    ],
)
def test_limits_refuse_declared_numbers(
    table: str, row: int, name: str, value: int, limits: Limits, refusal: str
) -> None:
    """Declared numbers are compared with the reader's limits before anything is allocated from them."""
    assert refusal_of(edit(BASE, table, row, name, value), LimitExceeded, limits=limits).refusal == refusal


def test_the_sample_passes_limits_it_just_meets() -> None:
    """Limits are inclusive."""
    root = get(BASE, H, 0, "root_length")
    limits = Limits(tiles=3, root_bytes=root, anchors=100, gaussians=100, tile_anchors=75, block_bytes=19)
    assert len(read_all(BASE, limits)) == 11


def test_the_deepest_last_cube_is_valid() -> None:
    """One past the last code of depth 21 is 2^63: no overflow in the order check."""
    tiles = [Tile(21, 0, 8**21 - 2), Tile(21, 0, 8**21 - 1)]
    data = write_container(FIELDS, tiles, [], [(0, 0)])
    assert list(Container(BytesSource(data)).tiles) == tiles


def test_an_unverified_read_returns_damaged_bytes() -> None:
    """verify=False is for callers with their own check, such as a range read."""
    damaged = flip_bits(BASE, -2)
    container = Container(BytesSource(damaged))
    assert container.read_block(container.entries[-1], verify=False) == damaged[-7:]


# ------------------------------------------------------------------------------------------------- truncation


def test_every_prefix_is_truncated_or_readable() -> None:
    """A cut file yields exactly its whole blocks; without permission it is refused as truncated."""
    full = Container(BytesSource(BASE)).load()
    for size in range(len(BASE)):
        source = BytesSource(BASE[:size])
        with pytest.raises(Truncated):
            Container(source)
        try:
            part = Container(source, allow_truncated=True).load()
        except Truncated:
            assert size < full.header.data_offset
            continue
        whole = [entry for entry in part.entries if part.is_available(entry)]
        assert [e for e in full.entries if e.end <= size] == whole
        assert [b for _, b in part.read_blocks(whole)] == [full.read_block(e) for e in whole]
        assert part.available_layers == sum(layer.end_offset <= size for layer in full.header.layers)
        refuses("truncated-block", partial(list, part.read_blocks(part.entries)), kind=Truncated)


def test_declared_sizes_allocate_nothing() -> None:
    """A header of 2^20 tiles and 2^24 bytes of ROOT in 500 bytes is refused from the numbers alone."""
    header = edit(sample_file(1), H, 0, "tile_count", 1 << 20)
    header = bytearray(header[: header_length(1)])
    front = header_length(1) + (1 << 24) + 3 * (1 << 20)
    size = get(bytes(header), L, 0, "byte_count")
    header[16:24] = header[124:132] = (front + size).to_bytes(8, "little")
    header[36:40] = (1 << 24).to_bytes(4, "little")
    container = Container(BytesSource(bytes(reheaded(header))), allow_truncated=True)
    refuses("truncated-directory", container.load, kind=Truncated)


# ---------------------------------------------------------------------------------------------------- writing


def test_pages_of_1024_tiles_are_written() -> None:
    """The default of the writer is what SPEC asks of encoders (R-5.4-18)."""
    assert Container(BytesSource(sample_file())).header.page_bits == 10


def _with(index: int, **changes: object) -> list[Block]:
    blocks = sample_blocks()
    blocks[index] = dataclasses.replace(blocks[index], **changes)
    return blocks


@pytest.mark.parametrize(
    ("write", "words"),
    [
        (lambda: write_container(FIELDS, TILES[::-1], sample_blocks(), COUNTS), "tile-order"),
        (lambda: write_container(FIELDS, TILES, sample_blocks() + sample_blocks()[:1], COUNTS), "entries ascend"),
        (lambda: write_container(FIELDS, TILES, sample_blocks() + sample_blocks()[2:3], COUNTS), "entries ascend"),
        (lambda: write_container(FIELDS, TILES, sample_blocks(), COUNTS, 17), "page"),
        (lambda: write_container(FIELDS, [Tile(22, 0, 0)], [], [(0, 0)]), "tile-depth"),
        (lambda: write_container(FIELDS, [Tile(1, 2, 8)], [], [(0, 0)]), "tile-prefix"),
        (lambda: write_container(FIELDS, TILES, _with(2, tile=None), COUNTS), "belong to a tile"),
        (lambda: write_container(FIELDS, TILES, _with(4, tile=0), COUNTS), "belong to a tile"),
        (lambda: write_container(FIELDS, TILES, _with(3, tile=3), COUNTS), "3 tiles"),
        (lambda: write_container(FIELDS, TILES, sample_blocks(), COUNTS[:2]), "block of layer 3 of 2"),
        (lambda: write_container(FIELDS, TILES, sample_blocks(), [(10, 10), (25, 25), (99, 99)]), "anchors"),
        (lambda: write_container(FIELDS, TILES, [], []), "a file has a layer"),
        (lambda: write_container(FIELDS, TILES, [], [(0, 0)] * 17), "bad-header-length"),
        (lambda: write_container(FIELDS, TILES, _with(0, payload=b""), COUNTS), "a byte or more"),
        (lambda: write_container(FIELDS, TILES, _with(0, kind=256), COUNTS), "does not fit"),
        (lambda: write_container(FIELDS, TILES, _with(2, count=1 << 32), COUNTS), "does not fit"),
        (lambda: write_container(FIELDS, TILES, _with(2, stream_bytes={1: 10}), COUNTS), "stream_bytes"),
        (lambda: write_container(FIELDS, TILES, _with(2, stream_bytes={0: 1}), COUNTS), "stream_bytes"),
        (lambda: write_container(FIELDS, TILES, _with(2, stream_bytes={len(Stream): 1}), COUNTS), "does not fit"),
        (lambda: write_container(dataclasses.replace(FIELDS, slots=300), TILES, [], [(0, 0)]), "does not fit"),
        (lambda: write_container(dataclasses.replace(FIELDS, voxel=0.0), TILES, [], [(0, 0)]), "bad-voxel"),
    ],
)
def test_the_writer_refuses_what_no_reader_would_accept(write: Callable[[], bytes], words: str) -> None:
    """A bug of an encoder shows up when the file is written, and names the rule."""
    refuses("input-container", write, words)
