"""The parts of the index network, prepared for evaluation: constants folded, tables made (SPEC §10.5)."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import I64
from scarfmt.neural.arithmetic import Linear, folded
from scarfmt.neural.network import QUERY_AMAX, Attention, GruLayer, Head
from scarfmt.neural.operations import Array, NumpyOperations
from scarfmt.neural.tables import LAST, exp2_table, sigmoid_table, state_table

GATES = 3
_RECURRENT_AMAX = 2047
_GATE_ONE = 4096
_SHARE_ONE = 256


class Rounded:
    """clamp(round_shift(W x + b, s), low, high).

    Attributes:
        weights, biases: (in, out) and (out,), whose sums are to be rounded down.
        low, high: the least and the greatest output.
    """

    def __init__(self, layer: Linear, do: NumpyOperations, low: int, high: int) -> None:
        self.weights, self.biases = (do.constant(array) for array in layer.folded)
        self._do, self.low, self.high = do, low, high

    def __call__(self, x: Array) -> Array:
        """(n, out) of (n, in)."""
        out = self._do.product(x, self.weights)
        out += self.biases
        return self._do.clip_(self._do.floor_(out), self.low, self.high)


class Logits:
    """round_shift(<e, o> + b, s) of k codewords e, transposed: sums over k are then sums of whole rows.

    Attributes:
        codewords, offsets: (k, R) and (k, 1), whose sums are to be rounded down.
        count: k.
    """

    def __init__(self, codewords: I64, biases: I64, shift: int, do: NumpyOperations) -> None:
        scaled, offset = folded(codewords, biases, shift)
        self.codewords, self.offsets, self._do = do.constant(scaled.T), do.constant(offset[:, None]), do
        self.count = len(codewords)

    def __call__(self, o: Array) -> Array:
        """(k, n) of (n, R)."""
        out = self._do.product(self.codewords, o.T)
        out += self.offsets
        return self._do.floor_(out)


class Recurrence:
    """One recurrent layer.

    Products are kept in two arrays, of the gates (z, r) and of the candidate n. Those of the input already hold
    the halves of the rounding.

    Args:
        codewords: layer 1: (n, R) of each codebook that has an input matrix; later layers: none.

    Attributes:
        width: H, of the state.
        tables: layer 1: per codebook, its codewords' products; later layers: none.
        inputs: later layers: the products' one matrix, (H, 2H) and (H, H); layer 1: none.
        biases: per token, (1, 2H) and (1, H).
        recurrent, recurrent_biases: (H, 2H) and (H, H), (1, 2H) and (1, H).
        sigmoid, tanh: (511,) of -255..255: in units of 1, and new states.
    """

    def __init__(self, layer: GruLayer, codewords: Sequence[I64], activation_bits: int, do: NumpyOperations) -> None:
        self._do, self.width = do, len(layer.start)
        gates = 2 * self.width
        inputs = [folded(matrix, layer.recurrent_biases, layer.shift)[0] for matrix in layer.inputs]
        # Float64 holds these integers too, and this product is made once.
        tables = [words.astype(np.float64) @ matrix for words, matrix in zip(codewords, inputs, strict=False)]
        self.tables = [self._split(table) for table in tables]
        self.inputs = [] if codewords else [self._split(matrix) for matrix in inputs]
        scale, half = 0.5**layer.shift, 0.5 if layer.shift else 0.0
        self.biases = [self._split(row[None] * scale + half) for row in layer.biases]
        recurrent, offset = folded(layer.recurrent, layer.recurrent_biases, layer.shift)
        offset[:gates] -= np.float32(half)
        self.recurrent, self.recurrent_biases = self._split(recurrent), self._split(offset[None])
        self.sigmoid = do.constant(sigmoid_table() / _GATE_ONE)
        self.tanh = do.constant(state_table(activation_bits))

    def _split(self, columns: NDArray[Any]) -> tuple[Array, Array]:
        gates = 2 * self.width
        return self._do.constant(columns[:, :gates]), self._do.constant(columns[:, gates:])

    def token_products(self, stage: int, codes: Array) -> tuple[Array, Array]:
        """Input products of layer 1 for the indices (n,) of `stage`."""
        tables, biases = self.tables[0 if stage == 1 else 1], self.biases[stage - 1]
        gates, candidate = (self._do.take(table, codes) for table in tables)
        gates += biases[0]
        candidate += biases[1]
        return gates, self._do.floor_(candidate)

    def state_products(self, below: Array) -> tuple[Array, Array]:
        """Input products of a later layer for the new state (n, H) of the layer below."""
        gates, candidate = (self._do.product(below, matrix) for matrix in self.inputs[0])
        gates += self.biases[0][0]
        candidate += self.biases[0][1]
        return gates, self._do.floor_(candidate)

    def step(self, products: tuple[Array, Array], state: Array) -> Array:
        """The new state (n, H); uses up `products`."""
        do, (gates, candidate) = self._do, products
        gates += do.product(state, self.recurrent[0])
        gates += self.recurrent_biases[0]
        gates = do.lookup_(self.sigmoid, do.floor_(gates), LAST)
        kept = do.product(state, self.recurrent[1])
        kept += self.recurrent_biases[1]
        kept = do.clip_(do.floor_(kept), -_RECURRENT_AMAX, _RECURRENT_AMAX)
        kept *= gates[:, self.width :]
        # Where a candidate is too large for the fraction to fit beside it, it is far outside the table of tanh.
        kept += candidate
        kept += 0.5
        new = do.lookup_(self.tanh, do.floor_(kept), LAST)
        # z g + (1 - z) n as n + z (g - n): 11 bits before the point, the 12 of z after it.
        change = state - new
        change *= gates[:, : self.width]
        change += new
        change += 0.5
        return do.floor_(change)


class Attending:
    """Attention over the states of the top layer; the key and value of its start state are constants."""

    def __init__(self, attention: Attention, start: I64, amax: int, do: NumpyOperations) -> None:
        self._do = do
        self.query = Rounded(attention.query, do, -QUERY_AMAX, QUERY_AMAX)
        self.key = Rounded(attention.key, do, -QUERY_AMAX, QUERY_AMAX)
        self.value = Rounded(attention.value, do, -amax, amax)
        first = do.constant(start[None])
        self._first_key = self.key(first).reshape(-1, 1)
        self.first_value = self.value(first)
        self._scale, self._half = 0.5**attention.shift, 0.5 if attention.shift else 0.0
        self._exp2 = do.constant(exp2_table())

    def __call__(self, query: Array, keys: Sequence[Array], values: Sequence[Array]) -> Array:
        """(n, H) c of n anchors, of (n, H) queries and the keys and values of each token."""
        do = self._do
        scores = do.empty(1 + len(keys), len(query))
        scores[0] = do.product(query, self._first_key)[:, 0]
        for number, key in enumerate(keys, start=1):
            scores[number] = do.dots(query, key)
        scores *= self._scale
        scores += self._half
        shares = do.shares(do.floor_(scores), self._exp2)
        shares *= 1 / _SHARE_ONE
        total = shares[0][:, None] * self.first_value
        for share, value in zip(shares[1:], values, strict=True):
            total += share[:, None] * value
        # No clamp: the shares sum to at most 1.
        total += 0.5
        return do.floor_(total)


class Predicting:
    """The head of one codebook.

    Attributes:
        sizes: codewords of each cluster; empty when flat.
        projections: one of the first symbol, and in a two-level head one of members.
        top: logits of the first symbol.
        members: those of each cluster's members; empty when flat.
    """

    def __init__(self, head: Head, codewords: I64, amax: int, do: NumpyOperations) -> None:
        self.sizes = head.clusters
        self.projections = [Rounded(layer, do, -amax, amax) for layer in head.projections]
        self.members: list[Logits] = []
        if not head.two_level:
            self.top = Logits(codewords, head.biases, head.shift, do)
            return
        self.top = Logits(head.centroids(codewords), head.cluster_biases, head.shift, do)
        deviations = head.deviations(codewords)
        starts = itertools.accumulate(self.sizes, initial=0)
        for part in (slice(first, last) for first, last in itertools.pairwise(starts)):
            self.members.append(Logits(deviations[part], head.biases[part], head.member_shift, do))

    def equal_runs(self) -> list[tuple[int, int]]:
        """Ranges first..last - 1 of consecutive clusters of one size, ascending, those of one codeword left out."""
        runs = [list(group) for _, group in itertools.groupby(range(len(self.sizes)), key=self.sizes.__getitem__)]
        return [(run[0], run[-1] + 1) for run in runs if self.sizes[run[0]] > 1]
