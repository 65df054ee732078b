"""Random models of the neural entropy model for the vectors, from :class:`conformance.scenes.prng.Prng`.

They are valid and lively: shifts are chosen, in integers, so that activations are neither all zero nor all clamped.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from conformance.scenes.prng import Prng
from scarfmt.arrays import I64
from scarfmt.container.schema import Stream
from scarfmt.neural.arithmetic import ACCUMULATOR_LIMIT, Linear, amplitude, half_step
from scarfmt.neural.grid import GridLevel, HashGrid
from scarfmt.neural.network import Attention, GruLayer, Head, IndexNetwork, Inputs
from scarfmt.neural.predictors import AMAX, Predictor, first_use, input_width
from scarfmt.scene.model import Codebooks, SceneModel

_LOGIT, _SCORE = 160, 48


@dataclass(frozen=True)
class PredictorPlan:
    """One predictor.

    Attributes:
        stream, component, step: its key.
        units, loudness: hidden units, and near which value a quarter of their reach lies.
        buckets: (B1, B2).
        classes: class columns with weights.
        wide: weights of two bytes.
        edge: biases bring every accumulator to the largest reach allowed.
    """

    stream: Stream
    component: int
    step: int
    units: int = 0
    buckets: tuple[int, int] = (3, 2)
    classes: int = 2
    wide: bool = False
    edge: bool = False
    loudness: int = 64


@dataclass(frozen=True)
class NetworkPlan:
    """An index network.

    Attributes:
        bits, widths, dims, layers: activation bits; U, H, Y; R; recurrent layers.
        classes, own, latents, latent_shift: inputs; depths and grid features follow from the scene.
        gate: near which value a quarter of the reach of a recurrent layer's products lies, when halved.
        attention: whether it has any.
        tokens: stages it has biases for, by default all but the last of the scene.
        wide: weights of two bytes.
        edge: biases bring every accumulator to the largest reach allowed.
        loudness: of the first layer of the embedding: small inputs then count.
        logits: of the coarse head whatever the state; the residual one then has none but 0. None: as the rest is.
    """

    bits: int = 10
    widths: tuple[int, int, int] = (5, 4, 6)
    dims: int = 3
    layers: int = 1
    classes: int = 2
    own: bool = True
    latents: int = 0
    latent_shift: int = 2
    gate: int = 96
    attention: bool = False
    tokens: int | None = None
    wide: bool = False
    edge: bool = False
    loudness: int = 1
    logits: tuple[int, ...] | None = None


@dataclass(frozen=True)
class GridPlan:
    """A hash grid; bits are drawn so that each level has another share of ones."""

    origin: tuple[int, int, int]
    extent_bits: int
    levels: tuple[GridLevel, ...]


class Numbers(Protocol):
    """Random integers: of a :class:`Prng`, or of NumPy's generators."""

    def integers(self, low: int, past: int, shape: Any, /) -> I64:
        """Numbers of low..past - 1."""


class _Maker:
    def __init__(self, prng: Numbers, amax: int, *, wide: bool, edge: bool) -> None:
        self.prng, self.amax, self.edge = prng, amax, edge
        self.top = 2000 if wide else 127

    def matrix(self, rows: int, columns: int, limit: int) -> I64:
        """Weights that take up to half of the reach allowed."""
        top = max(min(self.top, (limit // 2) // (self.amax * columns)), 1)
        return self.prng.integers(-top, top + 1, (rows, columns))

    def shift(self, matrices: list[I64], target: int) -> int:
        """The shift that brings a quarter of the largest reach near `target`."""
        reach = max(int(np.abs(matrix).sum(axis=1).max()) for matrix in matrices) * self.amax // 4
        return min(max(reach.bit_length() - target.bit_length(), 0), 20)

    def biases(self, matrices: list[I64], shift: int, limit: int, target: int) -> I64:
        """Biases of a few target units, or such that the worst matrix reaches exactly the limit less 1."""
        reach = np.max([np.abs(matrix).sum(axis=1) for matrix in matrices], axis=0) * self.amax
        room: I64 = limit - 1 - half_step(shift) - reach
        drawn = self.prng.integers(-target, target + 1, len(room)) << shift >> 1
        chosen: I64 = np.where(drawn < 0, -room, room) if self.edge else np.clip(drawn, -room, room)
        return chosen

    def linear(self, rows: int, columns: int, target: int) -> Linear:
        weights = self.matrix(rows, columns, ACCUMULATOR_LIMIT)
        shift = self.shift([weights], target)
        return Linear(weights.astype(np.int32), self.biases([weights], shift, ACCUMULATOR_LIMIT, target), shift)

    def gru(self, hidden: int, columns: int, matrices: int, tokens: int, gate: int) -> GruLayer:
        limit = ACCUMULATOR_LIMIT // 2
        inputs = [self.matrix(3 * hidden, columns, limit) for _ in range(matrices)]
        recurrent = self.matrix(3 * hidden, hidden, limit)
        shift = self.shift([*inputs, recurrent], 2 * gate)
        biases = [self.biases(inputs, shift, limit, gate) for _ in range(tokens)]
        return GruLayer(
            tuple(matrix.astype(np.int32) for matrix in inputs),
            recurrent.astype(np.int32),
            np.array(biases, np.int64).reshape(tokens, 3 * hidden),
            self.biases([recurrent], shift, limit, gate),
            self.prng.integers(-self.amax, self.amax + 1, hidden),
            shift,
        )

    def attention(self, hidden: int) -> Attention:
        layers = [self.linear(hidden, hidden, target) for target in (500, 300, self.amax // 2)]
        return Attention(layers[0], layers[1], layers[2], (100 * 100 * hidden // 2).bit_length() - _SCORE.bit_length())

    def head(self, codewords: I64, width: int, logits: I64 | None) -> Head:
        project = self.linear(codewords.shape[1], width, self.amax // 2)
        if logits is not None:
            return Head(Linear(0 * project.weights, 0 * project.biases, project.shift), logits, 0)
        shift = self.shift([codewords], _LOGIT)
        return Head(project, self.biases([codewords], shift, ACCUMULATOR_LIMIT, _LOGIT // 2), shift)


def random_network(
    prng: Prng, plan: NetworkPlan, model: SceneModel, books: Codebooks, grid: HashGrid | None
) -> IndexNetwork:
    """The index network of a plan, for a scene."""
    attributes = sum(model.channels[index].components for index in model.attributes)
    features = grid.width if grid is not None else 0
    inputs = Inputs(
        plan.classes, plan.own, attributes, len(model.context.occupancies), plan.latents, plan.latent_shift, features
    )
    tokens = model.max_stages - 1 if plan.tokens is None else plan.tokens
    return network_of(prng, plan, inputs, books, tokens)


def network_of(
    prng: Numbers, plan: NetworkPlan, inputs: Inputs, books: Codebooks, tokens: int, codeword_shift: int = 1
) -> IndexNetwork:
    """An index network with these inputs, and biases for so many stages after the first."""
    make = _Maker(prng, amplitude(plan.bits), wide=plan.wide, edge=plan.edge)
    first, hidden, mixed = plan.widths
    words = [book for book in (books.coarse, books.residual) if len(book)]
    columns = plan.dims + 1
    network = IndexNetwork(
        activation_bits=plan.bits,
        inputs=inputs,
        codeword_dims=plan.dims,
        codeword_shift=codeword_shift,
        embed=(
            make.linear(first, inputs.width, plan.loudness * make.amax // 2),
            make.linear(hidden, first, make.amax // 2),
        ),
        gru=tuple(
            make.gru(hidden, hidden if j else columns, 1 if j else len(words), 1 if j else tokens, plan.gate)
            for j in range(plan.layers)
        ),
        attention=make.attention(hidden) if plan.attention else None,
        mixer=make.linear(mixed, 2 * hidden, make.amax // 2),
        heads=(),
    )
    heads = tuple(
        make.head(network.codewords(book), mixed, _fixed(plan, number, len(book)))
        for number, book in enumerate(words)
    )
    return replace(network, heads=heads)


def _fixed(plan: NetworkPlan, number: int, size: int) -> I64 | None:
    if plan.logits is None:
        return None
    return np.zeros(size, np.int64) if number else np.array(plan.logits, np.int64)


def random_predictors(
    prng: Prng, plans: tuple[PredictorPlan, ...], model: SceneModel
) -> dict[int, tuple[Predictor, ...]]:
    """The predictors of some plans, in any order, by the layer they belong to."""
    out: dict[int, tuple[Predictor, ...]] = {}
    for plan in sorted(plans, key=lambda p: (p.stream, p.component, p.step)):
        index = model.channel_index(plan.stream)
        assert index is not None
        layer = first_use(model, index, plan.step)
        assert layer is not None
        out[layer] = (*out.get(layer, ()), _predictor(prng, plan, input_width(model, index)))
    return out


def _predictor(prng: Prng, plan: PredictorPlan, inputs: int) -> Predictor:
    make = _Maker(prng, AMAX, wide=plan.wide, edge=plan.edge)
    hidden = make.linear(plan.units, inputs, plan.loudness) if plan.units else None
    output = make.linear(2, inputs + plan.units, 2 * max(plan.buckets))
    layers = [layer for layer in (hidden, output) if layer is not None]
    for layer in layers:
        layer.weights[:, plan.classes : 15] = 0
    if plan.edge:
        # Class weights left out make room: fill it again.
        reach = [make.biases([layer.weights.astype(np.int64)], layer.shift, ACCUMULATOR_LIMIT, 8) for layer in layers]
        layers = [replace(layer, biases=biases) for layer, biases in zip(layers, reach, strict=True)]
        hidden, output = layers[0] if plan.units else None, layers[-1]
    return Predictor(plan.stream, plan.component, plan.step, hidden, output, plan.buckets)


def random_grid(prng: Prng, plan: GridPlan) -> HashGrid:
    """The grid of a plan."""
    bits = []
    for number, level in enumerate(plan.levels):
        drawn = prng.integers(0, 8, (level.entries, level.features))
        bits.append((drawn < 1 + 2 * (number % 4)).astype(np.uint8))
    return HashGrid(plan.origin, plan.extent_bits, plan.levels, tuple(bits))
