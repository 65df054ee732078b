"""The rules of a valid index network: every broken bound and shape is refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings

from scarfmt.errors import Malformed
from scarfmt.neural.arithmetic import Linear
from scarfmt.neural.network import MAX_TOKENS, GruLayer, Head, IndexNetwork, Inputs
from scarfmt.scene.codebooks import Codebooks
from scarfmt.scene.model import MAX_STAGES
from tests.neural.networks import Case, cases, random_books, random_network

INPUTS = Inputs(classes=2, own=True, attributes=3, depths=1, latents=2, latent_shift=1, grid=2)
BOOKS = random_books(np.random.default_rng(5), 20, 12, 4)
STAGES = 3
Change = Callable[[IndexNetwork], IndexNetwork]


def network(**options: Any) -> IndexNetwork:
    return random_network(np.random.default_rng(6), BOOKS, INPUTS, stages=STAGES, **options)


def refused(net: IndexNetwork, books: Codebooks = BOOKS, stages: int = STAGES) -> None:
    with pytest.raises(Malformed) as caught:
        net.check(books, stages)
    assert caught.value.refusal == "bad-network"


def test_the_input_width_is_the_sum_of_its_columns() -> None:
    """Own components count only where they are read."""
    assert INPUTS.width == 2 + 3 + (3 + 2 + 1) + 2
    assert replace(INPUTS, own=False, depths=3).width == 2 + 3 * 6 + 2


@settings(deadline=None, max_examples=50)
@given(cases())
def test_random_networks_are_valid_also_for_fewer_stages(case: Case) -> None:
    """At the edge of their bounds too; a truncated scene keeps the network of the whole one."""
    for stages in range(case.stages + 1):
        case.network.check(case.books, stages)
    case.network.check(replace(case.books, residual=case.books.residual[:0]), 1)


def test_there_are_tokens_for_every_stage_but_the_last() -> None:
    """The limits of the two modules belong together."""
    assert MAX_TOKENS == MAX_STAGES - 1


def linear(layer: Linear) -> list[Linear]:
    """The layer broken in each way a layer can be."""
    wider = Linear(np.pad(layer.weights, ((0, 0), (0, 1))), layer.biases, layer.shift)
    taller = Linear(np.pad(layer.weights, ((0, 1), (0, 0))), np.append(layer.biases, 0), layer.shift)
    heavy = replace(layer, biases=layer.biases + (1 << 24))
    return [wider, taller, heavy, replace(layer, biases=layer.biases[1:]), replace(layer, shift=25)]


def recurrent(layer: GruLayer) -> list[GruLayer]:
    first, *others = layer.inputs
    steep = np.zeros_like(layer.recurrent)
    steep[0] = 32767
    return [
        replace(layer, inputs=(first[1:], *others)),
        replace(layer, inputs=(first[:, 1:], *others)),
        replace(layer, inputs=layer.inputs + layer.inputs[:1]),
        replace(layer, inputs=others and (np.pad(first, ((0, 0), (0, 1))), *others)),
        replace(layer, recurrent=layer.recurrent[1:]),
        replace(layer, recurrent=layer.recurrent * 0 + 40000),
        replace(layer, recurrent=steep),
        replace(layer, biases=layer.biases[:, 1:]),
        replace(layer, biases=layer.biases + (1 << 23)),
        replace(layer, recurrent_biases=layer.recurrent_biases + (1 << 23)),
        replace(layer, recurrent_biases=layer.recurrent_biases[1:]),
        replace(layer, start=layer.start[1:]),
        replace(layer, start=layer.start * 0 + 512),
        replace(layer, shift=25),
    ]


def headed(head: Head) -> list[Head]:
    c = len(head.clusters)
    broken = [
        replace(head, projections=head.projections[:0]),
        replace(head, projections=(*head.projections, head.projections[0])),
        replace(head, biases=head.biases[1:]),
        replace(head, biases=head.biases + (1 << 24)),
        replace(head, cluster_biases=np.zeros(c + 1, np.int64)),
        replace(head, shift=25),
        replace(head, member_shift=25),
        *(replace(head, projections=(p, *head.projections[1:])) for p in linear(head.projections[0])),
    ]
    if head.two_level:
        broken += [
            replace(head, clusters=(head.clusters[0] + 1, *head.clusters[1:])),
            replace(head, clusters=(0, *head.clusters), cluster_biases=np.append(head.cluster_biases, 0)),
            replace(head, cluster_biases=head.cluster_biases + (1 << 24)),
        ]
    return broken


def broken_networks(net: IndexNetwork) -> list[IndexNetwork]:
    """Each breaks one rule of SPEC §10.5."""
    first, second = net.embed
    attention = net.attention
    assert attention is not None
    scalars: list[dict[str, Any]] = [
        {"activation_bits": 7}, {"activation_bits": 13}, {"codeword_dims": 0}, {"codeword_dims": 65},
        {"codeword_dims": 5}, {"codeword_shift": 25}, {"codeword_shift": -1}, {"gru": ()}, {"heads": ()},
        {"gru": net.gru[:1] + net.gru[1:] * 4}, {"heads": net.heads * 2}, {"heads": net.heads[:1]},
    ]  # fmt: skip
    inputs = [{"grid": 3}, {"latent_shift": 25}, {"classes": -1}, {"attributes": 4}, {"own": False}, {"depths": 600}]
    out = [replace(net, **change) for change in scalars]
    out += [replace(net, inputs=replace(net.inputs, **change)) for change in inputs]
    out += [replace(net, embed=(layer, second)) for layer in linear(first)]
    out += [replace(net, embed=(first, layer)) for layer in linear(second)]
    out += [replace(net, mixer=layer) for layer in linear(net.mixer)]
    out += [replace(net, gru=(layer, net.gru[1])) for layer in recurrent(net.gru[0])]
    out += [replace(net, gru=(net.gru[0], layer)) for layer in recurrent(net.gru[1])]
    rows = [net.gru[0].biases[:1], np.zeros((MAX_TOKENS + 1, 3 * net.hidden), np.int64)]
    out += [replace(net, gru=(replace(net.gru[0], biases=few), net.gru[1])) for few in rows]
    out.append(replace(net, gru=(net.gru[0], replace(net.gru[1], biases=net.gru[1].biases.repeat(2, axis=0)))))
    for name in ("query", "key", "value"):
        layers = linear(getattr(attention, name))
        out += [replace(net, attention=replace(attention, **{name: layer})) for layer in layers]
    out.append(replace(net, attention=replace(attention, shift=25)))
    out += [replace(net, heads=(head, net.heads[1])) for head in headed(net.heads[0])]
    out += [replace(net, heads=(net.heads[0], head)) for head in headed(net.heads[1])]
    return out


@pytest.mark.parametrize("two_level", [False, True])
def test_every_broken_rule_is_refused(two_level: bool) -> None:
    """From one valid network, one fault at a time."""
    net = network(gru_layers=2, two_level=two_level)
    net.check(BOOKS, STAGES)
    faults = broken_networks(net)
    for fault in faults:
        refused(fault)
    assert len(faults) > 90


def test_a_network_that_does_not_fit_the_scene_is_refused() -> None:
    """Other codebooks, more stages, more latent means than dimensions."""
    net = network()
    refused(net, stages=STAGES + 1)
    refused(net, replace(BOOKS, coarse=BOOKS.coarse[1:]))
    refused(net, replace(BOOKS, residual=BOOKS.residual[1:]))
    refused(random_network(np.random.default_rng(1), Codebooks(BOOKS.coarse, BOOKS.residual[:0]), INPUTS, stages=1))
    refused(replace(net, inputs=replace(net.inputs, latents=5, classes=0, grid=1)))


@pytest.mark.parametrize(("field", "shape"), [("mixer", (257, 16)), ("embed", (257, INPUTS.width))])
def test_layers_wider_than_256_are_refused(field: str, shape: tuple[int, int]) -> None:
    """The limit of the attention's score, and of the work a file may ask for."""
    layer = Linear(np.zeros(shape, np.int32), np.zeros(shape[0], np.int64), 0)
    net = network()
    heads = tuple(
        replace(h, projections=tuple(replace(p, weights=np.zeros((p.outputs, 257), np.int32)) for p in h.projections))
        for h in net.heads
    )
    second = replace(net.embed[1], weights=np.zeros((net.hidden, 257), np.int32))
    refused(replace(net, mixer=layer, heads=heads) if field == "mixer" else replace(net, embed=(layer, second)))


def test_bounds_of_logits_depend_on_the_codebook() -> None:
    """A codeword larger than what the network was made for breaks its head, flat or two-level."""
    for two_level in (False, True):
        net = replace(network(two_level=two_level, edge=True), codeword_shift=0)
        refused(net, replace(BOOKS, coarse=BOOKS.coarse * 50))


def test_centroids_are_floor_means() -> None:
    """Means of negative sums are rounded down, too; means and deviations add up to the codewords again."""
    words = np.array([[1, -1], [2, -2], [9, 9], [-4, 0], [-3, 0]])
    head = replace(network().heads[0], clusters=(2, 1, 2))
    assert head.centroids(words).tolist() == [[1, -2], [9, 9], [-4, 0]]
    assert head.deviations(words).tolist() == [[0, 1], [1, 0], [0, 0], [0, 0], [1, 0]]


def test_codewords_are_shifted_with_ties_up_and_clamped() -> None:
    """The leading dimensions only, then 8 for every binary digit of the sum of their squares."""
    net = replace(network(activation_bits=8), codeword_dims=3, codeword_shift=1)
    words = np.array([[1, -1, 3000, 7], [-3, 2, -3000, 7], [0, 0, 0, 7], [2, 0, 0, 7]])
    expected = [[1, 0, 127, 112], [-1, 1, -127, 112], [0, 0, 0, 0], [1, 0, 0, 8]]
    assert net.codewords(words).tolist() == expected


def test_multiply_adds_count_the_products_of_the_definition() -> None:
    """By hand for a small network: three stages, two-level heads."""
    net = network(hidden=8, mixed=5)
    per_head = [5 * 5 * 2 + 5 * (len(h.clusters) + len(h.biases) // len(h.clusters)) for h in net.heads]
    embed, gru = 9 * INPUTS.width + 8 * 9, 2 * (24 * 5 + 24 * 8)
    attention = 64 + 2 * 3 * 64 + 2 * 8 * (1 + 2 + 3)
    assert net.multiply_adds(3) == embed + gru + attention + 3 * 5 * 16 + per_head[0] + 2 * per_head[1]
