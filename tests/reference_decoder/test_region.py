"""Of a large directory a box needs the pages near it, and misses no tile."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from fuzz.testing.scenes import random_scene
from reference_decoder.decode import DecodeRequest, decode
from reference_decoder.reconstruct import positions
from reference_decoder.region import pages_meeting, tile_boxes, tiles_meeting
from scarfmt.arrays import F64
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.writer import write_scene
from scarfmt.container import paged
from scarfmt.container.directory import Table, Tile, tile_table
from scarfmt.container.file import Container
from scarfmt.container.morton import interleave
from scarfmt.container.schema import TILE_DTYPE
from scarfmt.container.source import BytesSource
from scarfmt.limits import MAX_TILE_DEPTH
from scarfmt.scene.model import Lattice
from tests.samples.paged_samples import Recorded, in_pages


def _meet(lattice: Lattice, tiles: Table, box: tuple[F64, F64]) -> NDArray[np.bool_]:
    """Tiles that a box may have something of, one by one."""
    low, high = tile_boxes(lattice, tiles)
    return np.asarray(((low <= box[1]) & (high >= box[0])).all(axis=1))


@st.composite
def divided(draw: st.DrawFn) -> tuple[Lattice, Table]:
    """A lattice and tiles in Morton order: nodes of an octree that was divided here and there."""
    bits = draw(st.integers(1, 32))
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    most = min(bits, MAX_TILE_DEPTH, draw(st.integers(1, 21)))
    nodes = [(0, 0)]
    for _ in range(draw(st.integers(0, 30))):
        depth, prefix = nodes[int(random.integers(len(nodes)))]
        if depth < most:
            nodes.remove((depth, prefix))
            nodes += [(depth + 1, prefix * 8 + child) for child in range(8)]
    kept = [node for node in nodes if random.random() < 0.8] or nodes[:1]
    kept.sort(key=lambda node: node[1] << 3 * (MAX_TILE_DEPTH - node[0]))
    tiles = np.zeros(len(kept), TILE_DTYPE)
    tiles["depth"], tiles["prefix"] = zip(*kept, strict=True)
    tiles["shift"] = [int(random.integers(bits - depth + 1)) for depth, _ in kept]
    return Lattice((-3.0, 0.1, 7.0), 0.3, bits), tiles


@settings(max_examples=200, deadline=None)
@given(divided(), st.integers(0, 3), st.integers(0, 2**32))
def test_no_page_that_holds_a_tile_of_the_box_is_left_out(
    made: tuple[Lattice, Table], page_bits: int, seed: int
) -> None:
    """Whatever the tiles, their shifts, the pages and the box."""
    lattice, tiles = made
    free = (3 * (MAX_TILE_DEPTH - tiles["depth"].astype(np.int64))).astype(np.uint64)
    bases = (tiles["prefix"] << free)[:: 1 << page_bits]
    random = np.random.default_rng(seed)
    side = lattice.voxel * 2.0**lattice.bits
    corner = np.asarray(lattice.origin) + side * random.uniform(-0.7, 1.5, 3)
    box = corner, corner + side * random.choice([0.0, 0.01, 0.3, 2.0])
    needed = set((np.flatnonzero(_meet(lattice, tiles, box)) >> page_bits).tolist())
    found = pages_meeting(lattice, bases, box).tolist()
    assert needed <= set(found)
    assert found == sorted(set(found))
    assert all(0 <= page < len(bases) for page in found)


def test_pages_far_from_the_box_are_not_read(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither of tiles nor of rows; what is decoded is the same."""
    # As if the directory were large: small ones are read whole.
    monkeypatch.setattr(paged, "AT_ONCE_BYTES", 0)
    data = in_pages(write_scene(random_scene(3, anchors=2000, layers=2, tiles=60)), 1)
    container = Container(BytesSource(data))
    lattice = SceneReader(BytesSource(data)).lattice
    low, high = tile_boxes(lattice, container.tile_table)
    pages = container.root.pages
    least = len(pages)
    for tile in range(0, 60, 7):
        middle = (low[tile] + high[tile]) / 2
        box = middle - 1e-6, middle + 1e-6
        source = Recorded(data)
        assert np.array_equal(tiles_meeting(SceneReader(source), box), _meet(lattice, container.tile_table, box))
        ranges = [(start, start + size) for start, size in source.ranges[1:]]
        read = [
            any(start <= offset and offset + size <= end for start, end in ranges)
            for offset, size in pages[["offset", "tile_bytes"]].tolist()
        ]
        least = min(least, sum(read))
        request = DecodeRequest(box=(box[0].tolist(), box[1].tolist()))
        assert np.array_equal(decode(data, request).tiles, decode(in_pages(data, 10), request).tiles)
    assert least < len(pages) / 4


def test_a_box_holds_anchors_half_a_cell_beyond_its_tile() -> None:
    """The farthest residuals, of a whole cell, at the first and the last cell."""
    lattice, tile = Lattice((1.0, -2.0, 0.0), 0.25, 12), Tile(3, 2, 5)
    low, high = tile_boxes(lattice, tile_table([tile]))
    ends = interleave(np.array([[0] * 3, [127] * 3]))
    assert np.array_equal(positions(lattice, tile, ends, np.array([[-1.0] * 3, [1.0] * 3])), [low[0], high[0]])
