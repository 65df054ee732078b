"""The directory page by page: only what is needed is read, in few requests, and is what reading all gives."""

from __future__ import annotations

import numpy as np
import pytest

from conformance.surgery.parts import flip_bits
from fuzz.testing.scenes import random_scene
from scarfmt.coding.writer import write_scene
from scarfmt.container import paged
from scarfmt.container.file import Container
from scarfmt.container.schema import BlockKind
from scarfmt.container.source import BytesSource
from scarfmt.errors import Malformed
from tests.samples.codec_samples import refuses
from tests.samples.paged_samples import Recorded, in_pages

PAGE = 4
ONE_PAGE = write_scene(random_scene(2, anchors=40, layers=3, tiles=40))
FILE = in_pages(ONE_PAGE, 2)
"""Ten pages. Only those of layer 3 have rows in pages 4 and 9, and no layer has any in page 8."""
WHOLE = Container(BytesSource(FILE)).load()


@pytest.fixture
def source(monkeypatch: pytest.MonkeyPatch) -> Recorded:
    """The file, as if its directory were large: small ones are read whole."""
    monkeypatch.setattr(paged, "AT_ONCE_BYTES", 0)
    return Recorded(FILE)


def spans(container: Container, layer: int, pages: range) -> list[tuple[int, int]]:
    """The one request for the row pages of a layer, or none."""
    rows = container.root.rows
    rows = rows[(rows["layer"] == layer) & np.isin(rows["page"], pages)]
    return [(int(rows["offset"][0]), int(rows["row_bytes"].sum()))] if len(rows) else []


def test_all_of_it_is_what_was_written(source: Recorded) -> None:
    """Tables and objects, in whatever pages; loading all of it is one request after that for the header."""
    container, written = Container(source).load(), Container(BytesSource(ONE_PAGE))
    assert (container.tile_table == written.tile_table).all()
    fields = [name for name in written.directory.dtype.names if name != "offset"]
    assert (container.directory[fields] == written.directory[fields]).all()
    header = container.header
    assert source.ranges[1:] == [(header.header_length, header.data_offset - header.header_length)]
    blocks = [block for _, block in written.read_blocks(written.entries)]
    assert [block for _, block in container.read_blocks(container.entries)] == blocks


def test_a_small_directory_is_one_request_whatever_is_asked_of_it() -> None:
    """Asking for its parts would take longer than they do."""
    source = Recorded(FILE)
    container = Container(source)
    for tile in range(40):
        assert container.find(BlockKind.TILE, 3, tile) == WHOLE.find(BlockKind.TILE, 3, tile)
    assert len(source.ranges) == 2


def test_a_block_is_found_with_root_and_its_page(source: Recorded) -> None:
    """A second block beside the first needs no further page."""
    container = Container(source)
    entries = [container.find(BlockKind.TILE, 3, tile) for tile in range(3 * PAGE, 4 * PAGE)]
    assert entries == [WHOLE.find(BlockKind.TILE, 3, tile) for tile in range(3 * PAGE, 4 * PAGE)]
    assert any(entries)
    root = (container.header.header_length, container.header.root_length)
    assert source.ranges[1:] == [root, *spans(container, 3, range(3, 4))]
    assert container.find(BlockKind.TILE, 1, 8 * PAGE) is None
    assert container.find(BlockKind.LAYER, 2) == WHOLE.find(BlockKind.LAYER, 2)
    assert len(source.ranges) == 3
    assert container.tile(3 * PAGE) == WHOLE.tiles[3 * PAGE]
    assert len(source.ranges) == 4


def test_fewer_layers_read_no_row_pages_of_later_ones(source: Recorded) -> None:
    """Tile pages and row pages of the first layers lie side by side: header, ROOT, and one request."""
    container = Container(source).load(1)
    start = container.header.header_length + container.header.root_length
    past = sum(spans(container, 1, range(10))[0])
    assert source.ranges[2:] == [(start, past - start)]
    assert (container.tile_counts(1, np.arange(40)) == WHOLE.tile_counts(1, np.arange(40))).all()
    assert len(source.ranges) == 3


@pytest.mark.parametrize("pages", [range(2, 5), range(4, 6)], ids=str)
def test_a_region_reads_the_pages_it_lies_in(source: Recorded, pages: range) -> None:
    """Each layer takes one request, because its pages follow one another; a layer without blocks there takes none."""
    container = Container(source)
    tiles = np.random.default_rng(1).permutation(np.arange(pages.start * PAGE, pages.stop * PAGE))
    counts = container.tile_counts(3, tiles)
    said = container.root.pages[pages.start : pages.stop]
    wanted = [(int(said["offset"][0]), int(said["tile_bytes"].sum()))]
    assert source.ranges[2:] == wanted + [span for layer in (1, 2, 3) for span in spans(container, layer, pages)]
    requests = len(source.ranges)
    assert requests == 2 + (4 if 3 in pages else 2)
    assert (container.tile_rows(tiles) == WHOLE.tile_table[tiles]).all()
    found = [[0 if e is None else e.count for e in container.tile_entries(tile, 3)] for tile in tiles.tolist()]
    assert counts.tolist() == found
    assert len(source.ranges) == requests


def test_pages_beside_damage_can_be_used(source: Recorded) -> None:
    """A page that is not needed is not read, so it is not refused either (R-5.5-11)."""
    offset, _ = spans(WHOLE, 1, range(3, 4))[0]
    container = Container(BytesSource(flip_bits(FILE, offset)))
    for layer, page in ((1, 6), (3, 3)):
        for tile in range(page * PAGE, page * PAGE + PAGE):
            assert container.find(BlockKind.TILE, layer, tile) == WHOLE.find(BlockKind.TILE, layer, tile)
    with pytest.raises(Malformed) as caught:
        container.find(BlockKind.TILE, 1, 3 * PAGE)
    assert (caught.value.refusal, caught.value.offset) == ("page-crc-mismatch", offset)
    refuses("page-crc-mismatch", lambda: container.load(1), kind=Malformed)
