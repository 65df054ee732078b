"""How many multiply-adds the index network and the hash grid take, as they are evaluated (SPEC §10.5, §10.6).

Unlike the work a file declares (SPEC §13.2), this follows :mod:`scarfmt.neural.evaluator`: products of codewords, and
all that comes before the second token, are tables made once. Elementwise operations of the gates are not counted.
"""

from __future__ import annotations

import numpy as np

from scarfmt.arrays import Ints
from scarfmt.counters import Counters, Part
from scarfmt.neural.grid import HashGrid
from scarfmt.neural.network import IndexNetwork
from scarfmt.scene.codebooks import Codebooks


class NetworkWork:
    """Adds to counters, or to nothing, what the index network multiplies.

    Args:
        network: what is evaluated.
        counters: to add to; None where nobody asked.
    """

    def __init__(self, network: IndexNetwork, counters: Counters | None) -> None:
        self._network, self._counters = network, counters

    def _add(self, rows: int, products: int, part: Part = Part.INDEX_NETWORK) -> None:
        assert self._counters is not None
        self._counters.multiply(part, rows, products)

    def embedded(self, rows: int) -> None:
        """Embeddings, their share of the mixer and, with attention, queries."""
        if self._counters is None:
            return
        net = self._network
        query = 0 if net.attention is None else net.attention.query.weights.size
        self._add(rows, sum(layer.weights.size for layer in net.embed) + _half_mixer(net) + query)

    def mixed(self, stage: int, rows: int) -> None:
        """Contexts of `stage`, from 1; that of the first needs nothing but the embedding's share."""
        if self._counters is None:
            return
        attended = 0 if self._network.attention is None else 2 * stage * self._network.hidden
        self._add(rows, (attended + _half_mixer(self._network)) * (stage > 1))

    def coded(self, stage: int, chosen: Ints) -> None:
        """Logits of the symbols of (n,) indices `chosen` of `stage`."""
        if self._counters is None:
            return
        head, dims = self._network.heads[int(stage > 1)], self._network.codeword_columns
        first = len(head.clusters) if head.two_level else len(head.biases)
        self._add(len(chosen), head.projections[0].weights.size + first * dims)
        if head.two_level:
            sizes = np.array(head.clusters)[np.searchsorted(head.starts, chosen, side="right") - 1]
            several = sizes[sizes > 1]
            self._add(len(several), head.projections[1].weights.size)
            self._add(int(several.sum()), dims)

    def advanced(self, stage: int, rows: int) -> None:
        """States after the indices of `stage`; those after the first are looked up."""
        if self._counters is None:
            return
        self._add(rows, _step(self._network) * (stage > 1))

    def prepared(self, books: Codebooks) -> None:
        """Tables of the input products of codewords, of states after the first token, and constants."""
        if self._counters is None:
            return
        net = self._network
        used = books.sizes[: len(net.heads)]
        self._add(sum(used), net.gru[0].inputs[0].size, Part.INDEX_TABLES)
        tokens = len(net.gru[0].biases)
        self._add(used[0] if tokens else 0, _step(net), Part.INDEX_TABLES)
        start = 0 if net.attention is None else net.attention.key.weights.size + net.attention.value.weights.size
        self._add(1, start + _half_mixer(net), Part.INDEX_TABLES)


def _half_mixer(network: IndexNetwork) -> int:
    """The mixer's products with the embedding, or with what was attended to."""
    return network.mixer.outputs * network.hidden


def _step(network: IndexNetwork) -> int:
    """One step of the recurrent layers whose input products are known in the first, and its key and value."""
    states = sum(layer.recurrent.size for layer in network.gru) + sum(layer.inputs[0].size for layer in network.gru[1:])
    if network.attention is None:
        return states
    return states + network.attention.key.weights.size + network.attention.value.weights.size


def grid_products(grid: HashGrid) -> int:
    """Multiply-adds of the features of one anchor: one a vertex and feature."""
    return sum(level.features << len(level.axes) for level in grid.levels)
