"""The index network as the compiled library reads it, where it has no attention (SPEC §10.5)."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from scarfmt.arrays import F32, I64
from scarfmt.kernel.members import PackedMembers, exp2_weights
from scarfmt.kernel.memory import address
from scarfmt.kernel.scratch import SCRATCH
from scarfmt.kernel.structs import HEADS, Indices, Linear, Network
from scarfmt.neural.evaluator import Evaluator
from scarfmt.neural.network import IndexNetwork
from scarfmt.neural.operations import NumpyOperations
from scarfmt.neural.parts import GATES, Logits, Predicting, Recurrence, Rounded

# Anchors side by side, and rows of weights that are multiplied at once.
_BLOCK, _ROWS = 16, 5
_LANE_BYTES = 4 * _BLOCK
_UNBOUNDED = float(1 << 25)


@dataclass(frozen=True)
class Affine:
    """floor(x weights + biases), clamped: (in, out) and (out,) float32, and the lowest and highest output."""

    weights: F32
    biases: F32
    low: float = -_UNBOUNDED
    high: float = _UNBOUNDED


@dataclass(frozen=True)
class Gates:
    """One recurrent layer: columns in the order z, r, n, as the evaluator adds them up.

    Attributes:
        tokens: the first layer: per codebook (codewords, 3H) products of the input; later ones: none.
        inputs: later layers: (H, 3H); the first: None.
        biases: (tokens, 3H) or (1, 3H), halves of the rounding with them.
        recurrent, offsets: (H, 3H) and (3H,).
    """

    tokens: Sequence[F32]
    inputs: F32 | None
    biases: F32
    recurrent: F32
    offsets: F32


@dataclass(frozen=True)
class HeadLayers:
    """A head: its projections, logits of codewords or clusters, and in a two-level one the members of clusters."""

    projections: Sequence[Affine]
    top: Affine
    members: PackedMembers | None


@dataclass(frozen=True)
class Parts:
    """What the evaluator of a network computes with.

    Attributes:
        embed: two layers.
        mix_embedding, mix_state: what the embedding (with the biases) and a state add to the mixer, (H, Y).
        mix_start: (Y,) what the start state adds.
        after_first: (codewords, layers * H) states after each coarse codeword; of no rows without tokens.
        gru: recurrent layers.
        tables: (511,) sigmoid, in units of 1, and new states.
        heads: by codebook; None for one that is empty.
    """

    embed: Sequence[Affine]
    mix_embedding: Affine
    mix_state: Affine
    mix_start: F32
    after_first: F32
    gru: Sequence[Gates]
    tables: tuple[F32, F32]
    heads: Sequence[HeadLayers | None]


class PackedNetwork:
    """A network as the library reads it.

    Args:
        network: valid, without attention.
        parts: of its evaluator.
        books: (n, d) codewords of each codebook.
    """

    def __init__(self, network: IndexNetwork, parts: Parts, books: Sequence[I64]) -> None:
        self._kept: list[Any] = []
        self.network, inputs = network, network.inputs
        struct = self.struct = Network(
            inputs.classes, inputs.own, inputs.attributes, inputs.latents, inputs.latent_shift, inputs.grid,
            network.amax, network.hidden, network.mixer.outputs, len(network.gru),
        )  # fmt: skip
        for number, layer in enumerate(parts.embed):
            struct.embed[number] = self._layer(layer)
        struct.mix_embedding, struct.mix_state = self._layer(parts.mix_embedding), self._layer(parts.mix_state)
        struct.mix_start, struct.after_first = self._array(parts.mix_start), self._array(parts.after_first)
        struct.sigmoid, struct.tanh = self._array(parts.tables[0]), self._array(parts.tables[1])
        struct.exp2 = address(exp2_weights(), np.uint32)
        for out, gates in zip(struct.gru, parts.gru, strict=False):
            for number, table in enumerate(gates.tokens):
                out.tokens[number] = self._array(table)
            out.inputs = None if gates.inputs is None else self._rows(gates.inputs)
            out.biases, out.offsets = self._array(gates.biases), self._array(gates.offsets)
            out.recurrent = self._rows(gates.recurrent)
        self._heads = parts.heads
        for out, head in zip(struct.heads, parts.heads, strict=False):
            if head is not None:
                self._fill_head(out, head)

        for number, book in enumerate(books):
            struct.books[number] = self._array(book[:, : inputs.latents].astype(np.float32))
            struct.sizes[number] = len(book)

    def _fill_head(self, out: Any, head: HeadLayers) -> None:
        out.first, out.top = self._layer(head.projections[0]), self._layer(head.top)
        if head.members is not None:
            out.second, out.members = self._layer(head.projections[1]), ctypes.pointer(head.members.struct)

    def _layer(self, layer: Affine) -> Linear:
        inputs, outputs = layer.weights.shape
        return Linear(inputs, outputs, self._rows(layer.weights), self._array(layer.biases), layer.low, layer.high)

    def _rows(self, weights: F32) -> int:
        """(in, out) weights turned round, and filled up with rows of zeros."""
        inputs, outputs = weights.shape
        rows = np.zeros((_filled(outputs), inputs), np.float32)
        rows[:outputs] = weights.T
        return self._array(rows)

    def _array(self, array: F32) -> int:
        self._kept.append(np.ascontiguousarray(array, np.float32))
        return int(self._kept[-1].ctypes.data)

    def codes(self, stages: int) -> bool:
        """Whether there is a head for every index of the first `stages`."""
        wanted = min(stages, HEADS)
        return len(self._heads) >= wanted and all(head is not None for head in self._heads[:wanted])

    def lend(self, struct: Indices, count: int, stages: int) -> None:
        """Lend memory for `count` anchors of which some code `stages`."""
        network, blocks = self.network, -(-count // _BLOCK)
        hidden, mixed = _filled(network.hidden), _filled(network.mixer.outputs)
        heads = [head for head in self._heads if head is not None]
        most, width = (max(_filled(head.top.weights.shape[axis]) for head in heads) for axis in (1, 0))
        embedded = network.inputs.width + _filled(network.embed[0].outputs) + hidden + mixed
        lanes = max(embedded, 2 * _filled(3 * network.hidden), mixed + hidden + width + most)
        structs = [head.members.struct for head in heads if head.members is not None]
        clusters, largest = (max((getattr(s, name) for s in structs), default=0) for name in ("clusters", "largest"))
        states = len(network.gru) * network.hidden if stages > HEADS else 0
        for name, size in {
            "chosen": 8 * count, "anchors": 8 * count, "coded": 8 * count, "clusters": 8 * count, "order": 8 * count,
            "means": 8 * _BLOCK * (network.inputs.attributes + network.inputs.latents),
            "lanes": _LANE_BYTES * lanes,
            "shares": _LANE_BYTES * blocks * network.mixer.outputs,
            "states": _LANE_BYTES * blocks * states,
            "weights": _LANE_BYTES * (most + 1),
            "outputs": 4 * count * width,
            "counts": 8 * (clusters + 1),
            "logits": 4 * largest, "member_weights": 4 * largest,
            "found": 4 * count,
        }.items():  # fmt: skip
            setattr(struct, name, SCRATCH.at(name, size))


def _filled(rows: int) -> int:
    return -(-rows // _ROWS) * _ROWS


def packed_network(evaluator: Evaluator) -> PackedNetwork | None:
    """The network of an evaluator; to be kept with it.

    None with attention, without codewords, or where something else than NumPy computes.
    """
    if evaluator.attend is not None or not isinstance(evaluator.operations, NumpyOperations) or not evaluator.heads:
        return None
    network, states = evaluator.network, evaluator.first.layers
    parts = Parts(
        [_affine(layer) for layer in evaluator.embedding],
        Affine(evaluator.mix_embedding, evaluator.mix_biases),
        Affine(evaluator.mix_state, evaluator.mix_biases),
        evaluator.mix_start[0],
        np.concatenate(states, axis=1) if states else np.zeros((0, 0), np.float32),
        [_gates(layer) for layer in evaluator.gru],
        (evaluator.gru[0].sigmoid, evaluator.gru[0].tanh),
        [_head(evaluator.heads[book]) if book in evaluator.heads else None for book in range(len(network.heads))],
    )
    return PackedNetwork(network, parts, (evaluator.books.coarse, evaluator.books.residual))


def packed_members(head: Predicting) -> PackedMembers:
    """The members of all clusters of a two-level head, in arrays of NumPy; to be kept with it."""
    parts = [_logits(members) for members in head.members]
    return PackedMembers([part.weights for part in parts], [part.biases for part in parts])


def _affine(layer: Rounded) -> Affine:
    return Affine(layer.weights, layer.biases, layer.low, layer.high)


def _logits(logits: Logits) -> Affine:
    return Affine(logits.codewords.T, logits.offsets[:, 0])


def _gates(layer: Recurrence) -> Gates:
    tables = [np.concatenate(table, axis=1) for table in layer.tables]
    inputs = None if tables else np.concatenate(layer.inputs[0], axis=1)
    biases = [np.concatenate(row, axis=1) for row in layer.biases]
    recurrent, offsets = (np.concatenate(p, axis=1) for p in (layer.recurrent, layer.recurrent_biases))
    none = np.zeros((0, GATES * layer.width), np.float32)
    return Gates(tables, inputs, np.concatenate([none, *biases]), recurrent, offsets[0])


def _head(head: Predicting) -> HeadLayers:
    members = head.kept(packed_members) if head.members else None
    return HeadLayers([_affine(layer) for layer in head.projections], _logits(head.top), members)
