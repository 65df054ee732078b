"""A run that hardly prices bytes still makes a file: cells are as wide as tables need."""

import pytest
import torch

import scarfmt
from reference_encoder.training.alphabets import fit_alphabets
from reference_encoder.training.emit import quantised_scene
from reference_encoder.training.state import State
from scarfmt.coding.writer import write_scene
from scarfmt.entropy.rans import MAX_ALPHABET
from tests.reference_encoder.training import small

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
    assert fit_alphabets(state) == 3
    assert (state.log_widths != before).nonzero()[:, 0].tolist() == [1, 7]
    assert fit_alphabets(state) == 0
    decoded = scarfmt.decode(write_scene(quantised_scene(state, {}, len(state.anchors))))
    assert len(decoded.positions) == int((state.anchors.first < layers).any(dim=1).sum())


def test_cells_are_not_wider_than_needed() -> None:
    """Before the last step of a quarter there were more values than a table has symbols."""
    state = narrow(1, 0)
    fit_alphabets(state)
    opened = state.anchors.first < state.plan.count
    values = state.anchors.offsets[opened][:, 0]
    width = torch.exp(state.log_offset_widths[0])
    counts = [len(torch.unique(torch.round(values / each))) for each in (width, width / 1.25)]
    assert counts[0] <= MAX_ALPHABET < counts[1]


def test_cells_that_fit_stay() -> None:
    """An ordinary scene is written with the cells that were learnt."""
    state = small.state(300, 3)
    before = state.log_widths.detach().clone(), state.log_offset_widths.detach().clone()
    assert fit_alphabets(state) == 0
    assert torch.equal(state.log_widths, before[0])
    assert torch.equal(state.log_offset_widths, before[1])
