"""The index network: P(index of a stage | indices before, decoded context) as integers (SPEC §10.5; paper §3.4).

An embedding of the decoded context, a recurrent state over the indices of earlier stages, attention over
its history, a mixer, and for each codebook a head whose logits are products with the codewords themselves:
codewords that lie close get similar probabilities, and a head stays small however large its codebook is.

Only what the network is and whether it is valid; :mod:`scarfmt.neural.evaluator` computes with it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scarfmt.arrays import I32, I64
from scarfmt.errors import Malformed
from scarfmt.neural.arithmetic import (
    ACCUMULATOR_LIMIT,
    MAX_ACTIVATION_BITS,
    MAX_SHIFT,
    MAX_WEIGHT,
    MIN_ACTIVATION_BITS,
    Linear,
    amplitude,
    check_rows,
    round_shift,
)
from scarfmt.scene.model import MAX_CLASSES, MAX_CODEWORDS, Codebooks

MAX_WIDTH = 256
MAX_INPUTS = 512
MAX_CODEWORD_DIMS = 64
MAX_GRU_LAYERS = 4
MAX_HEADS = 2
MAX_TOKENS = 7
QUERY_AMAX = 127
MAGNITUDE_UNIT = 8
"""A magnitude is this times the bit length of the squared length of a codeword, clamped to activations."""


@dataclass(frozen=True)
class Inputs:
    """The columns that the embedding reads, in this order: classes, own, per depth (means, count), grid (SPEC §10.5).

    Attributes:
        classes: columns of the class one-hot, at most 15.
        own: whether the anchor's own attribute components are read.
        attributes: A, components of the scene's attribute channels.
        depths: occupancy depths of the scene's decoded context.
        latents: L, leading latent dimensions averaged over neighbours.
        latent_shift: rounding shift of those averages, 0..24.
        grid: hash grid features, 0 for none.
    """

    classes: int
    own: bool
    attributes: int
    depths: int
    latents: int
    latent_shift: int
    grid: int

    @property
    def width(self) -> int:
        """Columns together."""
        own = self.attributes if self.own else 0
        return self.classes + own + self.depths * (self.attributes + self.latents + 1) + self.grid


@dataclass(frozen=True)
class GruLayer:
    """One recurrent layer; rows in the order z, r, n (SPEC §10.5).

    Attributes:
        inputs: layer 1: one (3H, R) int32 matrix a codebook, for that codebook's codewords; later layers: one
            (3H, H) matrix for the new state of the layer below.
        recurrent: (3H, H) int32.
        biases: int64, layer 1: (stages - 1, 3H), one row a token, of every stage but the last; later layers: (1, 3H).
        recurrent_biases: (3H,) int64.
        start: (H,) int64 state before the first token.
        shift: of both products.
    """

    inputs: tuple[I32, ...]
    recurrent: I32
    biases: I64
    recurrent_biases: I64
    start: I64
    shift: int


@dataclass(frozen=True)
class Attention:
    """Attention of the embedding over the states of the top layer: three (H, H) layers and the shift of a score."""

    query: Linear
    key: Linear
    value: Linear
    shift: int


@dataclass(frozen=True)
class Head:
    """Logits of one codebook of n codewords (SPEC §10.5).

    Attributes:
        project: (R, Y) layer, of the vector that is multiplied with codewords.
        biases: (n,) int64, one a codeword.
        shift: of the logits.
    """

    project: Linear
    biases: I64
    shift: int


def as_activations(words: I64, shift: int, amax: int) -> I64:
    """(n, R + 1) int64 of (n, R) codewords: rounded to activations, then their magnitude.

    The magnitude tells the many that stand for "next to nothing" from the rest, which no product with a codeword can.
    """
    e = np.clip(round_shift(words, shift), -amax, amax)
    magnitudes = MAGNITUDE_UNIT * np.frexp((e * e).sum(axis=1, keepdims=True).astype(np.float64))[1]
    return np.concatenate([e, np.minimum(magnitudes, amax)], axis=1)


@dataclass(frozen=True)
class IndexNetwork:
    """The whole network of an ENTROPY_NETWORK block.

    Attributes:
        activation_bits: a, 8..12.
        inputs: columns of the embedding.
        codeword_dims: R, leading codeword dimensions the network sees.
        codeword_shift: rounding shift that brings codewords to activations, 0..24.
        embed: (E, width) with ReLU, then (H, E).
        gru: 1..4 layers.
        attention: absent: the newest state of the top layer stands in its place.
        mixer: (Y, 2H), with ReLU.
        heads: coarse, residual (absent when there is no residual codebook).
    """

    activation_bits: int
    inputs: Inputs
    codeword_dims: int
    codeword_shift: int
    embed: tuple[Linear, Linear]
    gru: tuple[GruLayer, ...]
    attention: Attention | None
    mixer: Linear
    heads: tuple[Head, ...]

    @property
    def amax(self) -> int:
        """Largest activation."""
        return amplitude(self.activation_bits)

    @property
    def hidden(self) -> int:
        """H, width of embedding and states."""
        return self.embed[1].outputs

    def codewords(self, book: I64) -> I64:
        """(n, R + 1) int64 codewords as activations, then their magnitude, of an (n, d) codebook."""
        return as_activations(book[:, : self.codeword_dims], self.codeword_shift, self.amax)

    @property
    def codeword_columns(self) -> int:
        """The columns of a codeword that the network reads: R dimensions and the magnitude."""
        return self.codeword_dims + 1

    def check_structure(self) -> None:
        """Check shapes, ranges and every bound that does not depend on a codebook.

        Raises:
            Malformed: ``bad-network``.
        """
        _require(MIN_ACTIVATION_BITS <= self.activation_bits <= MAX_ACTIVATION_BITS, "activation bits outside 8..12")
        _require(1 <= self.codeword_dims <= MAX_CODEWORD_DIMS, "codeword dimensions outside 1..64")
        _require(0 <= self.codeword_shift <= MAX_SHIFT, "a codeword shift outside 0..24")
        _check_inputs(self.inputs)
        first, second = self.embed
        h, y = self.hidden, self.mixer.outputs
        _check_linear(first, (first.outputs, self.inputs.width), self.amax)
        _check_linear(second, (h, first.outputs), self.amax)
        _require(max(first.outputs, h, y) <= MAX_WIDTH, f"a layer wider than {MAX_WIDTH}")
        _require(1 <= len(self.heads) <= MAX_HEADS, "neither one head nor two")
        _require(1 <= len(self.gru) <= MAX_GRU_LAYERS, "neither 1 nor up to 4 recurrent layers")
        for number, layer in enumerate(self.gru):
            wide = (self.codeword_columns, len(self.heads)) if number == 0 else (h, 1)
            _check_gru(layer, h, *wide, self.amax)
            _require(number == 0 or len(layer.biases) == 1, "a later recurrent layer has one row of biases")
        tokens = len(self.gru[0].biases)
        _require(tokens <= MAX_TOKENS, f"biases for more than {MAX_TOKENS} tokens")
        _require(not tokens or len(self.heads) == MAX_HEADS, "later stages without a head")
        if self.attention is not None:
            _check_attention(self.attention, h, self.amax)
        _check_linear(self.mixer, (y, 2 * h), self.amax)
        for head in self.heads:
            _check_head(head, self.codeword_columns, y, self.amax)

    def check(self, books: Codebooks, stages: int) -> None:
        """Check the network, and that it fits `books` and the `stages` of the scene.

        A codebook that is still empty is not checked: its layer has not arrived.

        Raises:
            Malformed: ``bad-network`` for a shape that does not fit or a bound that is broken.
        """
        self.check_structure()
        _require(self.codeword_dims <= books.dimension, "more codeword dimensions than the latent has")
        _require(self.inputs.latents <= books.dimension, "more latent means than the latent has dimensions")
        # More are right: a scene cut after an early layer has fewer stages than its network.
        _require(len(self.gru[0].biases) >= stages - 1, f"too few stage biases for {stages} stages")
        for number, book in enumerate((books.coarse, books.residual)):
            _require(not len(book) or number < len(self.heads), "no head for the residual codebook")
            if len(book):
                _check_logits(self.heads[number], self.codewords(book), self.amax)

    def multiply_adds(self, stages: int) -> int:
        """Multiplications of one anchor that codes all `stages`, evaluated as SPEC §10.5 states it, without tables."""
        h, tokens = self.hidden, max(stages - 1, 0)
        recurrent = sum(layer.inputs[0].size + layer.recurrent.size for layer in self.gru)
        total = sum(layer.weights.size for layer in self.embed) + tokens * recurrent + stages * self.mixer.weights.size
        if self.attention is not None:
            pairs = stages * (stages + 1) // 2
            total += self.attention.query.weights.size + 2 * stages * self.attention.key.weights.size + 2 * pairs * h
        per_head = [head.project.weights.size + len(head.biases) * self.codeword_columns for head in self.heads]
        return int(total + per_head[0] + tokens * per_head[-1])


def _require(condition: bool, message: str) -> None:
    if not condition:
        raise Malformed("bad-network", f"{message} (SPEC §10.5)", field="network")


def _check_inputs(inputs: Inputs) -> None:
    counts = (inputs.classes, inputs.attributes, inputs.depths, inputs.latents, inputs.grid)
    _require(min(counts) >= 0 and 1 <= inputs.width <= MAX_INPUTS, f"neither 1 nor up to {MAX_INPUTS} input columns")
    _require(inputs.classes <= MAX_CLASSES, f"columns for more than {MAX_CLASSES} classes")
    _require(0 <= inputs.latent_shift <= MAX_SHIFT, "a latent shift outside 0..24")


def _check_linear(layer: Linear, shape: tuple[int, int], amax: int) -> None:
    _require(layer.weights.shape == shape, f"weights {layer.weights.shape} where {shape} are expected")
    layer.check(amax)


def _check_gru(layer: GruLayer, hidden: int, columns: int, matrices: int, amax: int) -> None:
    _require(len(layer.inputs) == matrices, f"{len(layer.inputs)} input matrices where {matrices} are expected")
    shapes: list[tuple[tuple[int, ...], tuple[int, ...]]] = [(m.shape, (3 * hidden, columns)) for m in layer.inputs]
    shapes += [(layer.recurrent.shape, (3 * hidden, hidden)), (layer.recurrent_biases.shape, (3 * hidden,))]
    shapes += [(layer.biases.shape[1:], (3 * hidden,)), (layer.start.shape, (hidden,))]
    for found, wanted in shapes:
        _require(found == wanted, f"a recurrent array of shape {found} where {wanted} is expected")
    _require(int(np.abs(layer.start).max()) <= amax, "a start state outside the activations")
    # Half of the limit each: the two products are added before they are rounded.
    worst_bias = np.abs(layer.biases).max(axis=0, initial=0)
    for matrix, bias in [*((m, worst_bias) for m in layer.inputs), (layer.recurrent, layer.recurrent_biases)]:
        _require(int(np.abs(matrix.astype(np.int64)).max(initial=0)) <= MAX_WEIGHT, f"a weight above {MAX_WEIGHT}")
        check_rows(matrix, bias, amax, layer.shift, limit=ACCUMULATOR_LIMIT // 2)


def _check_attention(attention: Attention, hidden: int, amax: int) -> None:
    # The bound of a score, 256 * 127 * 127 + 2^23 < 2^24, holds for every width and shift allowed.
    for layer in (attention.query, attention.key, attention.value):
        _check_linear(layer, (hidden, hidden), amax)
    _require(0 <= attention.shift <= MAX_SHIFT, "an attention shift outside 0..24")


def _check_head(head: Head, dims: int, width: int, amax: int) -> None:
    _check_linear(head.project, (dims, width), amax)
    _require(1 <= len(head.biases) <= MAX_CODEWORDS, "a head for no codeword, or too many")
    _require(0 <= head.shift <= MAX_SHIFT, "a logit shift outside 0..24")


def _check_logits(head: Head, codewords: I64, amax: int) -> None:
    _require(len(codewords) == len(head.biases), f"{len(head.biases)} biases for {len(codewords)} codewords")
    check_rows(codewords, head.biases, amax, head.shift)
