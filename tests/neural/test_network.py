"""The rules of a valid index network: every broken bound and shape is refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from hypothesis import given, settings

from scarfmt.neural.network import IndexNetwork, Inputs
from tests.neural.networks import Case, cases, random_books, random_network

INPUTS = Inputs(classes=2, own=True, attributes=3, depths=1, latents=2, latent_shift=1, grid=2)
BOOKS = random_books(np.random.default_rng(5), 20, 12, 4)
STAGES = 3


def network(**options: Any) -> IndexNetwork:
    return random_network(np.random.default_rng(6), BOOKS, INPUTS, stages=STAGES, **options)


def test_the_input_width_is_the_sum_of_its_columns() -> None:
    """Own components count only where they are read."""
    assert INPUTS.width == 2 + 3 + (3 + 2 + 1) + 2
    assert replace(INPUTS, own=False, depths=3).width == 2 + 3 * 6 + 2


@settings(max_examples=50)
@given(cases())
def test_random_networks_are_valid_also_for_fewer_stages(case: Case) -> None:
    """At the edge of their bounds too; a truncated scene keeps the network of the whole one."""
    for stages in range(case.stages + 1):
        case.network.check(case.books, stages)
    case.network.check(replace(case.books, residual=case.books.residual[:0]), 1)


def test_codewords_are_shifted_with_ties_up_and_clamped() -> None:
    """The leading dimensions only, then 8 for every binary digit of the sum of their squares."""
    net = replace(network(activation_bits=8), codeword_dims=3, codeword_shift=1)
    words = np.array([[1, -1, 3000, 7], [-3, 2, -3000, 7], [0, 0, 0, 7], [2, 0, 0, 7]])
    expected = [[1, 0, 127, 112], [-1, 1, -127, 112], [0, 0, 0, 0], [1, 0, 0, 8]]
    assert net.codewords(words).tolist() == expected


def test_multiply_adds_count_the_products_of_the_definition() -> None:
    """By hand for a small network: three stages."""
    net = network(hidden=8, mixed=5)
    per_head = [5 * 5 + 5 * len(head.biases) for head in net.heads]
    embed, gru = 9 * INPUTS.width + 8 * 9, 2 * (24 * 5 + 24 * 8)
    attention = 64 + 2 * 3 * 64 + 2 * 8 * (1 + 2 + 3)
    assert net.multiply_adds(3) == embed + gru + attention + 3 * 5 * 16 + per_head[0] + 2 * per_head[1]
