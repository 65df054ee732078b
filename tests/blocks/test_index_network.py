"""The block of the index network: everything comes back, and no payload does anything but refuse."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings

from scarfmt.blocks.index_network import pack_network, unpack_network
from scarfmt.neural.network import IndexNetwork, Inputs
from tests.neural.networks import Case, cases, random_books, random_network

INPUTS = Inputs(classes=1, own=True, attributes=2, depths=1, latents=1, latent_shift=1, grid=0)


def same(a: Any, b: Any) -> bool:
    """Equal in every field, arrays in type and shape too."""
    if is_dataclass(a):
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    if isinstance(a, tuple):
        return isinstance(b, tuple) and len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and a.shape == b.shape and bool((a == b).all())
    return type(a) is type(b) and bool(a == b)


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
