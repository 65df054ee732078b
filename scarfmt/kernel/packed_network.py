"""The index network as the compiled library reads it, where it has no attention (SPEC §10.5)."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np

from scarfmt.arrays import I64
from scarfmt.kernel.members import EXP2_WEIGHTS, PackedMembers
from scarfmt.kernel.memory import address
from scarfmt.kernel.scratch import SCRATCH
from scarfmt.kernel.structs import HEADS, Indices, Layer, Network, Recurrence
from scarfmt.kernel.words import PackedLayers
from scarfmt.neural.arithmetic import Linear, half_step
from scarfmt.neural.evaluator import Evaluator
from scarfmt.neural.network import GruLayer
from scarfmt.neural.operations import NumpyOperations
from scarfmt.neural.tables import sigmoid_table, state_table

# Anchors side by side.
_BLOCK = 16
_LANE_BYTES = 4 * _BLOCK


class PackedNetwork:
    """A network as the library reads it.

    Args:
        evaluator: of a valid network, without attention.
    """

    def __init__(self, evaluator: Evaluator) -> None:
        self._memory = PackedLayers()
        self._kept: list[Any] = []
        self.network = network = evaluator.network
        inputs, amax = network.inputs, network.amax
        struct = self.struct = Network(
            inputs.classes, inputs.own, inputs.attributes, inputs.latents, inputs.latent_shift, inputs.grid,
            amax, network.hidden, len(network.gru),
        )  # fmt: skip
        struct.embed[0] = self._layer(network.embed[0], 0)
        struct.embed[1] = self._layer(network.embed[1], -amax)
        self._fill_mixer(network.mixer, network.gru[-1].start)
        states = evaluator.first.layers
        struct.after_first = self._memory.words(np.concatenate(states, axis=1)) if states else None
        struct.sigmoid = self._memory.words(sigmoid_table())
        struct.tanh = self._memory.words(state_table(network.activation_bits))
        struct.exp2 = address(EXP2_WEIGHTS, np.uint32)
        books = (evaluator.books.coarse, evaluator.books.residual)
        words = [network.codewords(book) for book in books]
        for number, layer in enumerate(network.gru):
            self._fill_recurrence(struct.gru[number], layer, [] if number else words)
        self._coded = [number in evaluator.heads for number in range(len(network.heads))]
        for number in evaluator.heads:
            self._fill_head(evaluator, number, words[number])
        for number, book in enumerate(books):
            self._kept.append(np.ascontiguousarray(book[:, : inputs.latents], np.float32))
            struct.books[number], struct.sizes[number] = self._kept[-1].ctypes.data, len(book)

    def _layer(self, layer: Linear, low: int) -> Layer:
        return self._memory.layer(layer.weights, layer.biases, layer.shift, low, self.network.amax)

    def _fill_mixer(self, mixer: Linear, start: I64) -> None:
        """Fill in both halves of the mixer: that of the embedding, with biases, and that of the state. One sum is
        rounded."""
        struct, hidden = self.struct, self.network.hidden
        none, state = np.zeros(mixer.outputs, np.int64), mixer.weights[:, hidden:]
        rounded = mixer.biases + half_step(mixer.shift)
        struct.mix_embedding = self._memory.layer(mixer.weights[:, :hidden], rounded)
        struct.mix_state, struct.mix_shift = self._memory.layer(state, none), mixer.shift
        struct.mix_start = self._memory.words(np.pad(state.astype(np.int64) @ start, (0, mixer.outputs % 2)))

    def _fill_recurrence(self, out: Recurrence, layer: GruLayer, words: Sequence[I64]) -> None:
        """`words`: the first layer: codewords of each codebook, whose products are made here."""
        biases = layer.biases + half_step(layer.shift)
        for number, (codewords, matrix) in enumerate(zip(words, layer.inputs, strict=False)):
            out.tokens[number] = self._memory.words(codewords @ matrix.T.astype(np.int64))
        if not words:
            out.inputs = self._memory.layer(layer.inputs[0], biases[0])
        out.biases = self._memory.words(biases)
        out.recurrent = self._memory.layer(layer.recurrent, layer.recurrent_biases)
        out.shift = layer.shift

    def _fill_head(self, evaluator: Evaluator, number: int, words: I64) -> None:
        out, head = self.struct.heads[number], self.network.heads[number]
        amax, memory = self.network.amax, self._memory
        out.first, out.size = self._layer(head.projections[0], -amax), len(head.clusters or words)
        if not head.two_level:
            out.top = memory.layer(words, head.biases, head.shift)
            return
        members = evaluator.kept(packed_members, number)
        self._kept.append(members)
        out.top = memory.layer(head.centroids(words), head.cluster_biases, head.shift)
        out.second, out.members = self._layer(head.projections[1], -amax), ctypes.pointer(members.struct)

    def codes(self, stages: int) -> bool:
        """Whether there is a head for every index of the first `stages`."""
        wanted = min(stages, HEADS)
        return len(self._coded) >= wanted and all(self._coded[:wanted])

    def lend(self, struct: Indices, count: int, stages: int) -> None:
        """Lend memory for `count` anchors of which some code `stages`."""
        packed, blocks = self.struct, -(-count // _BLOCK)
        hidden, mixed, width = packed.hidden, packed.mix_state.rows, self.network.inputs.width
        heads = [head for head, coded in zip(packed.heads, self._coded, strict=False) if coded]
        most = max(head.top.rows for head in heads)
        words = max(head.top.words for head in heads)
        state = hidden + (hidden + 1) // 2
        members = [head.members.contents for head in heads if head.members]
        clusters, largest = (max((getattr(m, name) for m in members), default=0) for name in ("clusters", "largest"))
        states = packed.layers * hidden if stages > HEADS else 0
        columns = self.network.inputs.attributes + self.network.inputs.latents
        embedded = sum(layer.words for layer in packed.embed) + packed.mix_embedding.words
        lanes = max(embedded, 2 * (3 * hidden + 1) + state, mixed + max(words + most, mixed + state))
        for name, size in {
            "chosen": 8 * count, "anchors": 8 * count, "coded": 8 * count, "clusters": 8 * count, "order": 8 * count,
            "means": _LANE_BYTES * (columns + 4), "inputs": _LANE_BYTES * (width + 1),
            "lanes": _LANE_BYTES * lanes,
            "shares": _LANE_BYTES * blocks * mixed,
            "states": _LANE_BYTES * blocks * states,
            "weights": _LANE_BYTES * (most + 1),
            "outputs": 4 * count * words,
            "counts": 8 * (clusters + 1),
            "logits": _LANE_BYTES * largest, "member_weights": _LANE_BYTES * largest,
            "found": 4 * count,
        }.items():  # fmt: skip
            setattr(struct, name, SCRATCH.at(name, size))


def packed_network(evaluator: Evaluator) -> PackedNetwork | None:
    """The network of an evaluator; to be kept with it.

    None with attention, without codewords, or where something else than NumPy computes.
    """
    if evaluator.attend is not None or not isinstance(evaluator.operations, NumpyOperations) or not evaluator.heads:
        return None
    return PackedNetwork(evaluator)


def packed_members(evaluator: Evaluator, number: int) -> PackedMembers:
    """The members of all clusters of the two-level head of codebook `number`; to be kept with the evaluator."""
    head = evaluator.network.heads[number]
    book = (evaluator.books.coarse, evaluator.books.residual)[number]
    deviations = head.deviations(evaluator.network.codewords(book))
    return PackedMembers(deviations, head.biases, head.clusters, head.member_shift)
