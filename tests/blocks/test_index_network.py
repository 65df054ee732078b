"""The block of the index network: everything comes back, and no payload does anything but refuse."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings

from scarfmt.blocks.index_network import pack_network, unpack_network
from scarfmt.neural.network import IndexNetwork, Inputs
from tests.neural.networks import Case, cases, random_books, random_network
from tests.samples.equality import same

INPUTS = Inputs(classes=1, own=True, attributes=2, depths=1, latents=1, latent_shift=1, grid=0)


def small(**options: Any) -> IndexNetwork:
    rng = np.random.default_rng(4)
    return random_network(rng, random_books(rng, 5, 4, 2), INPUTS, hidden=3, **options)


@settings(deadline=None, max_examples=100)
@given(cases())
def test_networks_come_back(case: Case) -> None:
    """Networks of every kind come back, with weights and biases of any size."""
    assert same(unpack_network(pack_network(case.network)), case.network)


def with_weight(weight: int) -> IndexNetwork:
    """A network whose mixer has one weight, no bias and no shift."""
    network = small()
    weights = np.zeros_like(network.mixer.weights)
    weights[0, 1] = weight
    return replace(network, mixer=replace(network.mixer, weights=weights, biases=network.mixer.biases * 0, shift=0))


@pytest.mark.parametrize("extreme", [32767, -32767])
def test_the_largest_weights_come_back(extreme: int) -> None:
    """Among zeros."""
    changed = with_weight(extreme)
    assert same(unpack_network(pack_network(changed)), changed)
