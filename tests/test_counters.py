"""The counts of a decode: asking for less reads less, with the C library and without it. Nothing here is timed."""

from __future__ import annotations

import numpy as np
import pytest
from scarfmt_conformance.archive import names, read

from fuzz.testing.neural_scenes import neural_scene
from fuzz.testing.scenes import random_scene
from reference_decoder.decode import decode
from reference_decoder.region import tile_boxes
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.tile import find_needed
from scarfmt.coding.writer import write_scene
from scarfmt.container.schema import BlockKind, Stream
from scarfmt.container.source import BytesSource
from scarfmt.container.substreams import MAX_TABLE_SIZE, unpack_table
from scarfmt.counters import Counters
from scarfmt.tools.inspection import inspect

ALWAYS = {Stream.POSITIONS, Stream.CLASSES, Stream.MASKS}


def test_tiles_alone_take_together_what_all_take() -> None:
    """The counts of single tiles add up to those of all; a tile that is not requested counts nothing."""
    scene = neural_scene(28, anchors=80, tiles=3, layers=2)
    data = write_scene(scene)
    whole, opening, parts = Counters(), Counters(), []
    decode(data, counters=whole)
    decode(data, tiles=[], counters=opening)
    for tile, content in enumerate(scene.contents):
        part = Counters()
        decode(data, tiles=[tile], counters=part)
        assert (part.tiles, part.anchors) == (len(content) > 0, len(content))
        parts.append(part)
    assert (opening.tiles, opening.anchors, opening.tile_blocks) == (0, 0, 0)
    assert whole.model_blocks == opening.model_blocks == len(SceneReader(BytesSource(data)).container.models)
    for name in ("tiles", "anchors", "tile_blocks"):
        assert sum(getattr(part, name) for part in parts) == getattr(whole, name)
    assert sum(part.bytes_read - opening.bytes_read for part in parts) == whole.bytes_read - opening.bytes_read


def test_a_box_takes_what_the_tiles_it_meets_take() -> None:
    """No byte of the others."""
    data = write_scene(random_scene(5, anchors=400, tiles=8))
    reader = SceneReader(BytesSource(data))
    low, high = tile_boxes(reader.lattice, reader.container.tile_table)
    box = (low[3] + 0.4 * (high[3] - low[3]), high[3] - 0.4 * (high[3] - low[3]))
    hit = np.flatnonzero(((low <= box[1]) & (high >= box[0])).all(axis=1)).tolist()
    assert 0 < len(hit) < 8
    in_box, of_hit, whole = Counters(), Counters(), Counters()
    decode(data, box=box, counters=in_box)
    decode(data, tiles=hit, counters=of_hit)
    decode(data, counters=whole)
    assert in_box == of_hit
    assert 0 < in_box.bytes_read < whole.bytes_read
    nowhere = Counters()
    assert len(decode(data, box=((90, 90, 90), (91, 91, 91)), counters=nowhere)) == 0
    assert (nowhere.tiles, nowhere.tile_blocks) == (0, 0)


@pytest.mark.parametrize("native", [True, False])
def test_attributes_take_the_sub_streams_they_need_and_no_other(native: bool) -> None:
    """To the byte: of each block, the table and what of it is needed."""
    for seed in (3, 28):
        data = write_scene(neural_scene(seed, anchors=80, tiles=3, layers=2))
        part, opening = Counters(), Counters()
        decode(data, tiles=[], counters=opening, native=native)
        decode(data, attributes=["positions", "opacity"], counters=part, native=native)
        reader = SceneReader(BytesSource(data))
        models = reader.models()
        wanted = {Stream.POSITION_RESIDUAL, Stream.OPACITY}
        needed = find_needed(models.model, wanted, models.neural()[-1]) | ALWAYS
        assert Stream.INDICES not in needed
        taken = 0
        for entry in reader.container.entries:
            if entry.kind == BlockKind.TILE:
                table = unpack_table(reader.container.read_block(entry), entry.length)
                taken += min(entry.length, MAX_TABLE_SIZE)
                taken += sum(record.length for stream, record in table.items() if stream in needed)
        assert part.bytes_read - opening.bytes_read == taken


def test_looking_at_a_file_reads_its_header_and_opening_it_its_directory() -> None:
    """`inspect` needs one read; no block is read until models or tiles are requested."""
    for name in names("valid/*"):
        source = BytesSource(read(name))
        inspect(source)
        assert source.reads == 1
        assert source.bytes_read <= 2280
        header_bytes, header = source.bytes_read, SceneReader(source).header
        assert source.bytes_read - header_bytes == header_bytes + header.data_offset - header.header_length
