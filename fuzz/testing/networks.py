"""Random valid index networks, for every test that needs one (SPEC §10.5)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import I64
from scarfmt.neural.arithmetic import ACCUMULATOR_LIMIT, MAX_WEIGHT, Linear, amplitude, half_step
from scarfmt.neural.network import QUERY_AMAX, Attention, GruLayer, Head, IndexNetwork, Inputs
from scarfmt.scene.model import Codebooks

LOGIT = 160


def random_books(rng: np.random.Generator, coarse: int, residual: int, dimension: int) -> Codebooks:
    """Codewords of falling range, as a decorrelated latent has them."""
    scale = 400 / (1 + np.arange(dimension))
    words = [np.rint(rng.normal(size=(n, dimension)) * scale * part) for n, part in ((coarse, 1), (residual, 0.5))]
    return Codebooks(words[0].astype(np.int64), words[1].astype(np.int64))


def random_network(
    rng: np.random.Generator,
    books: Codebooks,
    inputs: Inputs,
    *,
    stages: int = 3,
    hidden: int = 8,
    activation_bits: int = 10,
    two_level: bool = True,
    attention: bool = True,
    gru_layers: int = 1,
    mixed: int | None = None,
    codeword_dims: int | None = None,
    cluster_size: int | None = None,
    edge: bool = False,
    pre_activation: float = 96,
) -> IndexNetwork:
    """A valid network whose activations are neither all zero nor all clamped.

    Args:
        stages: of the scene.
        mixed: Y, by default `hidden`.
        codeword_dims: R, by default up to 6 of the latent's dimensions.
        cluster_size: equal clusters of this size; by default random sizes, also 1.
        edge: biases bring every accumulator to exactly the largest reach allowed.
        pre_activation: typical size of the recurrent layers' products; tanh and sigmoid end at 255.
    """
    make = _Maker(rng, activation_bits, edge, pre_activation)
    dims = min(books.dimension, 6) if codeword_dims is None else codeword_dims
    y = hidden if mixed is None else mixed
    words = [book for book in (books.coarse, books.residual) if len(book)]
    shift = make.codeword_shift([w[:, :dims] for w in words])
    network = IndexNetwork(
        activation_bits=activation_bits,
        inputs=inputs,
        codeword_dims=dims,
        codeword_shift=shift,
        embed=(make.linear(hidden + 1, inputs.width), make.linear(hidden, hidden + 1)),
        gru=tuple(
            make.gru(hidden, hidden if i else dims + 1, 1 if i else len(words), 1 if i else stages - 1)
            for i in range(gru_layers)
        ),
        attention=make.attention(hidden) if attention else None,
        mixer=make.linear(y, 2 * hidden),
        heads=(),
    )
    heads = tuple(make.head(network.codewords(w), y, two_level, cluster_size) for w in words)
    network = IndexNetwork(**{**network.__dict__, "heads": heads})
    network.check(books, stages)
    return network


@dataclass(frozen=True)
class _Maker:
    rng: np.random.Generator
    bits: int
    edge: bool
    pre_activation: float

    @property
    def amax(self) -> int:
        return amplitude(self.bits)

    def codeword_shift(self, books: list[I64]) -> int:
        """Least shift that keeps logits, of codewords or their deviations, well below the limit."""
        for shift in range(24):
            e = [np.clip(book >> shift, -self.amax, self.amax) for book in books]
            if max(int((2 * np.abs(words) + 2).sum(axis=1).max()) for words in e) * self.amax < ACCUMULATOR_LIMIT // 4:
                return shift
        raise AssertionError("codewords that fit no shift")

    def rows(self, out: int, columns: int, limit: int, target: float) -> tuple[NDArray[Any], int]:
        """(out, columns) weights and the shift that brings their products near `target`."""
        reach = 0.9 * limit / self.amax / columns
        top = min(MAX_WEIGHT, int(reach if self.edge else min(reach, 127)))
        weights = self.rng.integers(-top, top + 1, (out, columns))
        spread = top / 1.7 * self.amax / 3 * np.sqrt(columns)
        shift = max(0, round(np.log2(spread / target)))
        while int(np.abs(weights).sum(axis=1).max()) * self.amax + half_step(shift) >= limit:
            weights //= 2
            shift -= 1
        return weights.astype(np.int32), shift

    def biases(self, weights: NDArray[Any], limit: int, shift: int) -> I64:
        """Biases that fit, or that fill the limit."""
        room = limit - 1 - half_step(shift) - np.abs(weights.astype(np.int64)).sum(axis=1) * self.amax
        sign = self.rng.choice([-1, 1], len(room))
        size = room if self.edge else np.minimum(room, self.rng.integers(0, 8 << shift, len(room)))
        return np.asarray(sign * size, np.int64)

    def linear(self, out: int, columns: int, target: float | None = None) -> Linear:
        weights, shift = self.rows(out, columns, ACCUMULATOR_LIMIT, self.amax / 2 if target is None else target)
        return Linear(weights, self.biases(weights, ACCUMULATOR_LIMIT, shift), shift)

    def gru(self, hidden: int, columns: int, matrices: int, tokens: int) -> GruLayer:
        limit = ACCUMULATOR_LIMIT // 2
        recurrent, shift = self.rows(3 * hidden, hidden, limit, self.pre_activation)
        inputs = tuple(self.rows(3 * hidden, columns, limit, self.pre_activation)[0] for _ in range(matrices))
        worst = np.max([np.abs(m).sum(axis=1) for m in inputs], axis=0)[:, None]
        biases = [self.biases(worst, limit, shift) for _ in range(tokens)]
        start = self.rng.integers(-self.amax, self.amax + 1, hidden)
        bias_rows = np.array(biases, np.int64).reshape(tokens, 3 * hidden)
        return GruLayer(inputs, recurrent, bias_rows, self.biases(recurrent, limit, shift), start, shift)

    def attention(self, hidden: int) -> Attention:
        query, key = (self.linear(hidden, hidden, QUERY_AMAX / 2) for _ in range(2))
        shift = max(0, round(np.log2(40 * 40 * np.sqrt(hidden) / 64)))
        return Attention(query, key, self.linear(hidden, hidden), shift)

    def head(self, e: I64, width: int, two_level: bool, size: int | None) -> Head:
        projections = tuple(self.linear(e.shape[1], width) for _ in range(1 + two_level))
        shift = max(0, round(np.log2(1 + np.abs(e).mean() * self.amax / 3 * np.sqrt(e.shape[1]) / LOGIT)))
        if not two_level:
            return Head(projections, (), np.zeros(0, np.int64), self.biases(e, ACCUMULATOR_LIMIT, shift), shift, 0)
        sizes = self.cluster_sizes(len(e)) if size is None else (size,) * (len(e) // size)
        plain = Head(projections, sizes, np.zeros(len(sizes), np.int64), np.zeros(len(e), np.int64), shift, shift)
        top = self.biases(plain.centroids(e), ACCUMULATOR_LIMIT, shift)
        return Head(projections, sizes, top, self.biases(plain.deviations(e), ACCUMULATOR_LIMIT, shift), shift, shift)

    def cluster_sizes(self, codewords: int) -> tuple[int, ...]:
        cuts = self.rng.choice(codewords, self.rng.integers(0, min(codewords, 12)), replace=False)
        edges = np.unique(np.concatenate(([0], cuts, [codewords])))
        return tuple(int(n) for n in np.diff(edges))
