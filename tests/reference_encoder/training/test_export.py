"""The file has the values that training chose: gates, classes, positions, integers; its tables hold them."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

import scarfmt
from reference_encoder.training import export
from reference_encoder.training.export import cut_tiles, fit_table_limits, quantise_scene, slot_layers, tile_rows
from reference_encoder.training.state import State
from scarfmt.coding.writer import write_scene
from scarfmt.container.morton import deinterleave
from scarfmt.entropy.rans import MAX_ALPHABET
from tests.reference_encoder.training import small


@pytest.mark.parametrize("layers", [1, 3])
def test_every_anchor_is_where_it_was_with_what_it_had(layers: int) -> None:
    """Positions are exact lattice points, slots open in the first layer that shows them, values are the integers."""
    state = small.state(300, layers)
    decoded = scarfmt.decode(write_scene(quantise_scene(state, {}, len(state.anchors))))
    opened = slot_layers(state)
    kept = (opened > 0).any(dim=1)
    places = state.frame.world(state.anchors.lattice[kept]).double().numpy()
    mine = {tuple(np.round(p, 4)): row for p, row in zip(places, (opened[kept] > 0).numpy(), strict=True)}
    assert len(decoded.positions) == len(mine)
    for place, slots in zip(decoded.positions, decoded.slots, strict=True):
        assert np.array_equal(mine[tuple(np.round(place, 4))], slots)


def test_a_layer_without_new_anchors_makes_no_gap() -> None:
    """Classes are numbered without gaps, whatever was decided: a file with an empty layer is a file."""
    state = small.state(50, 3)
    state.anchors.first.fill_(0)
    state.anchors.first[:20] = 2
    data = write_scene(quantise_scene(state, {}, len(state.anchors)))
    counts = [layer["anchors"] for layer in scarfmt.inspect(data)["layers"]]
    assert counts[0] == counts[1] < counts[2]


@given(st.integers(1, 300), st.integers(1, 21), st.integers(1, 40), st.integers(0, 100))
def test_anchors_are_where_their_tile_says(count: int, bits: int, most: int, seed: int) -> None:
    """Corner and local code give the lattice point; tiles hold what they may, layers and codes ascend in each."""
    random = np.random.default_rng(seed)
    codes = np.unique(random.integers(0, 1 << 3 * bits, count, dtype=np.uint64))
    appears = random.integers(0, 3, len(codes))
    table, tiles, local = cut_tiles(codes, bits, most)
    depth = np.array([tile.depth for tile in table])[tiles]
    prefix = np.array([tile.prefix for tile in table], np.uint64)[tiles]
    corner = deinterleave(prefix) << (bits - depth).astype(np.uint64)[:, None]
    assert np.array_equal(corner + deinterleave(local), deinterleave(codes))
    rows = tile_rows(tiles, local, appears)
    assert np.array_equal(np.sort(np.concatenate(rows)), np.arange(len(codes)))
    for tile, here in enumerate(rows):
        assert 0 < len(here) <= most
        assert (tiles[here] == tile).all()
        keys = list(zip(appears[here].tolist(), local[here].tolist(), strict=True))
        assert keys == sorted(keys)


def test_a_scene_of_several_tiles_is_the_same_scene(monkeypatch: pytest.MonkeyPatch) -> None:
    """Large scenes are cut into tiles, and hold the same anchors as one tile would."""
    state = small.state(300, 3)
    whole = scarfmt.decode(write_scene(quantise_scene(state, {}, 300)))
    monkeypatch.setattr(export, "default_tile_size", lambda count: 40)
    scene = quantise_scene(state, {}, 300)
    assert len(scene.tiles) > 3
    cut = scarfmt.decode(write_scene(scene))
    one, other = (np.lexsort(scene.positions.T) for scene in (whole, cut))
    assert np.array_equal(whole.positions[one], cut.positions[other])
    assert np.array_equal(whole.slots[one], cut.slots[other])


NARROW = -12.0
"""Logarithm of a width at which all of some thousands of values differ."""


def narrow(layers: int, component: int) -> State:
    """More anchors than a table has symbols, with narrow cells of one component of scalings, latents and offsets."""
    state = small.state(6000, layers)
    with torch.no_grad():
        state.log_widths[[component, 6 + component]] = NARROW
        state.log_offset_widths[component] = NARROW
    return state


@pytest.mark.parametrize("layers", [1, 3])
def test_cells_are_widened_until_a_file_can_be_written(layers: int) -> None:
    """The writer takes what it refused; only the components that were too fine change, and not twice."""
    state = narrow(layers, 1)
    before = state.log_widths.detach().clone()
    assert fit_table_limits(state) == 3
    assert (state.log_widths != before).nonzero()[:, 0].tolist() == [1, 7]
    assert fit_table_limits(state) == 0
    decoded = scarfmt.decode(write_scene(quantise_scene(state, {}, len(state.anchors))))
    assert len(decoded.positions) == int((state.anchors.first < layers).any(dim=1).sum())


def test_cells_are_not_wider_than_needed() -> None:
    """Before the last step of a quarter there were more values than a table has symbols."""
    state = narrow(1, 0)
    fit_table_limits(state)
    opened = state.anchors.first < state.plan.count
    values = state.anchors.offsets[opened][:, 0]
    width = torch.exp(state.log_offset_widths[0])
    counts = [len(torch.unique(torch.round(values / each))) for each in (width, width / 1.25)]
    assert counts[0] <= MAX_ALPHABET < counts[1]


def test_cells_that_fit_stay() -> None:
    """An ordinary scene is written with the cells that were learnt."""
    state = small.state(300, 3)
    before = state.log_widths.detach().clone(), state.log_offset_widths.detach().clone()
    assert fit_table_limits(state) == 0
    assert torch.equal(state.log_widths, before[0])
    assert torch.equal(state.log_offset_widths, before[1])
