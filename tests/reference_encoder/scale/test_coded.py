"""The file of a scene in ranges is the one that the writer makes of all its integers at once."""

from __future__ import annotations

import json
import zlib

import numpy as np

from reference_decoder.decode import decode
from reference_encoder.scale.coded import histograms, reduce, together
from reference_encoder.scale.steps import RangeContent
from scarfmt.container.file import Container
from scarfmt.container.schema import BlockKind
from scarfmt.container.source import BytesSource
from scarfmt.render.camera import orbit_cameras
from scarfmt.render.metrics import psnr
from scarfmt.render.rasterise import render
from tests.reference_encoder.scale.chain import Chain, encoded, example, written

SIZE = 1200


def test_blocks_of_ranges_are_those_of_the_whole() -> None:
    chain = encoded(SIZE)
    assert len(chain.ranges) >= 4
    container = Container.open(BytesSource(written(chain)))
    models = {(block.layer, block.kind): block.payload for block in chain.models.blocks}
    for layer in range(1, len(chain.fit.model.layers) + 1):
        rows = [row for row in container.directory if row["layer"] == layer]
        tiles = [row for row in rows if row["kind"] == BlockKind.TILE]
        parts = [(segment, segment.layers[layer - 1]) for segment in chain.segments]
        crcs = np.concatenate([part.checksums for _, part in parts])
        assert [int(row["crc32"]) for row in tiles] == crcs.tolist()
        assert [int(row["length"]) for row in tiles] == np.concatenate([part.lengths for _, part in parts]).tolist()
        assert [int(row["count"]) for row in tiles] == np.concatenate([part.counts for _, part in parts]).tolist()
        before = np.cumsum([0, *(len(segment.tiles) for segment in chain.segments)])
        numbers = np.concatenate([first + part.tiles for first, (_, part) in zip(before, parts, strict=False)])
        assert [int(row["tile"]) for row in tiles] == numbers.tolist()
        for row in rows:
            if row["kind"] != BlockKind.TILE:
                assert zlib.crc32(models[layer, int(row["kind"])]) == int(row["crc32"])
        summary = container.header.layers[layer - 1]
        streams = np.sum([part.stream_bytes for _, part in parts], axis=0)
        assert summary.stream_bytes[1:] == tuple(streams[1:].tolist())
        assert summary.anchor_count == int(chain.models.anchors[layer - 1])
    assert container.tiles == tuple(tile for segment in chain.segments for tile in segment.tiles)


def test_a_payload_is_its_blocks() -> None:
    for segment in encoded(SIZE).segments:
        for layer in segment.layers:
            ends = np.cumsum(layer.lengths)
            parts = [layer.payload[end - size : end] for end, size in zip(ends, layer.lengths, strict=True)]
            assert [zlib.crc32(part) for part in parts] == layer.checksums.tolist()
            assert len(layer.payload) == sum(layer.lengths)


def test_the_file_looks_like_the_scene() -> None:
    decoded = decode(written(encoded(SIZE))).scene
    levels = [psnr(render(example(), c), render(decoded, c)) for c in orbit_cameras(example(), 4, 160, 120)]
    assert np.mean(levels) > 36


def test_histograms_add_up_in_any_order_and_groups() -> None:
    chain = encoded(SIZE)
    parts = [histograms(chain.fit, content)[0] for content in chain.contents]
    grouped = [together(parts[2:]), together(parts[:2])]
    told = {"quality": json.loads(metadata(chain))["quality"]}
    assert reduce(chain.overview, chain.fit, grouped, told).blocks == chain.models.blocks


def metadata(chain: Chain) -> bytes:
    """The METADATA block."""
    return next(block.payload for block in chain.models.blocks if block.kind == BlockKind.METADATA)


def test_a_range_of_which_nothing_is_sent_has_no_blocks() -> None:
    chain = encoded(SIZE)
    found, symbols = histograms(chain.fit, RangeContent((), (), (3, 4)))
    assert not any(symbols.layers)
    assert not any(found.layers)
    assert not found.anchors.any()
    assert found.left_out == (3, 4)
