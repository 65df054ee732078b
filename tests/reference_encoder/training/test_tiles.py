"""Tiles of a trained scene: all anchors are in one, in the order of the file."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import scarfmt
from reference_encoder.training import tiles
from reference_encoder.training.emit import quantised_scene
from reference_encoder.training.tiles import Tiles
from scarfmt.coding.writer import write_scene
from scarfmt.container.morton import deinterleave
from tests.reference_encoder.training import small


@given(st.integers(1, 300), st.integers(1, 21), st.integers(1, 40), st.integers(0, 100))
def test_anchors_are_where_their_tile_says(count: int, bits: int, most: int, seed: int) -> None:
    """Corner and local code give the lattice point; tiles hold what they may, layers and codes ascend in each."""
    random = np.random.default_rng(seed)
    codes = np.unique(random.integers(0, 1 << 3 * bits, count, dtype=np.uint64))
    appears = random.integers(0, 3, len(codes))
    found = Tiles.of(codes, bits, most)
    depth = np.array([tile.depth for tile in found.tiles])[found.tile]
    prefix = np.array([tile.prefix for tile in found.tiles], np.uint64)[found.tile]
    corner = deinterleave(prefix) << (bits - depth).astype(np.uint64)[:, None]
    assert np.array_equal(corner + deinterleave(found.codes), deinterleave(codes))
    rows = found.anchors(appears)
    assert np.array_equal(np.sort(np.concatenate(rows)), np.arange(len(codes)))
    for tile, here in enumerate(rows):
        assert 0 < len(here) <= most
        assert (found.tile[here] == tile).all()
        keys = list(zip(appears[here].tolist(), found.codes[here].tolist(), strict=True))
        assert keys == sorted(keys)


def test_a_scene_of_several_tiles_is_the_same_scene(monkeypatch: pytest.MonkeyPatch) -> None:
    """Large scenes are cut into tiles, and hold the same anchors as one tile would."""
    state = small.state(300, 3)
    whole = scarfmt.decode(write_scene(quantised_scene(state, {}, 300)))
    monkeypatch.setattr(tiles, "usual_tile", lambda count: 40)
    scene = quantised_scene(state, {}, 300)
    assert len(scene.tiles) > 3
    cut = scarfmt.decode(write_scene(scene))
    one, other = (np.lexsort(scene.positions.T) for scene in (whole, cut))
    assert np.array_equal(whole.positions[one], cut.positions[other])
    assert np.array_equal(whole.slots[one], cut.slots[other])
