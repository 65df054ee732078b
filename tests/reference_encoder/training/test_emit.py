"""The file has the values that training chose: gates, classes, positions, integers."""

import numpy as np
import pytest

import scarfmt
from reference_encoder.training.emit import quantised_scene, slot_layers
from scarfmt.coding.writer import write_scene
from tests.reference_encoder.training import small


@pytest.mark.parametrize("layers", [1, 3])
def test_every_anchor_is_where_it_was_with_what_it_had(layers: int) -> None:
    """Positions are exact lattice points, slots open in the first layer that shows them, values are the integers."""
    state = small.state(300, layers)
    decoded = scarfmt.decode(write_scene(quantised_scene(state, {}, len(state.anchors))))
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
    data = write_scene(quantised_scene(state, {}, len(state.anchors)))
    counts = [layer["anchors"] for layer in scarfmt.inspect(data)["layers"]]
    assert counts[0] == counts[1] < counts[2]
