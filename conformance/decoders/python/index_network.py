"""ENTROPY_NETWORK blocks, and the frequencies that an index network gives (SPEC §10.5)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from conformance.decoders.python.arithmetic import (
    Linear,
    Matrix,
    Vector,
    clamp,
    dot,
    exp2w,
    product,
    read_matrix,
    round_shift,
    sigmoid12,
    tanh12,
)
from conformance.decoders.python.fields import Rans, Table, cumulative, require
from conformance.decoders.python.numbers import Numbers
from conformance.decoders.python.predictors import MAX_CLASSES


class Gru(NamedTuple):
    """A recurrent layer."""

    shift: int
    wi: list[Matrix]
    wh: Matrix
    bi: Matrix
    bh: Vector
    start: Vector


class Attention(NamedTuple):
    """Query, key and value layers."""

    query: Linear
    key: Linear
    value: Linear
    shift: int


class Head(NamedTuple):
    """The head of one codebook."""

    project: Linear
    shift: int
    biases: Vector


@dataclass
class Network:
    """An ENTROPY_NETWORK block. Read it with :func:`parse_network`."""

    bits: int
    own: bool
    latent_shift: int
    codeword_shift: int
    classes: int
    attributes: int
    depths: int
    latents: int
    grid: int
    dims: int
    tokens: int
    embed: tuple[Linear, Linear]
    gru: list[Gru]
    attention: Attention | None
    mixer: Linear
    heads: list[Head]

    @property
    def amax(self) -> int:
        return (1 << (self.bits - 1)) - 1

    def state(self, u: int) -> int:
        return clamp(round_shift(tanh12(u), 12 - self.bits), -self.amax, self.amax)

    def activations(self, codeword: Vector) -> Vector:
        e = [clamp(round_shift(v, self.codeword_shift), -self.amax, self.amax) for v in codeword[: self.dims]]
        return [*e, min(8 * dot(e, e).bit_length(), self.amax)]

    def embedding(self, x: Vector) -> Vector:
        first, second = self.embed
        return second(first(x, 0, self.amax), -self.amax, self.amax)

    def gru_step(self, j: int, t: int, u: Vector, g: Vector) -> Vector:
        layer = self.gru[j]
        wi, bi = layer.wi[min(t - 1, 1) if j == 0 else 0], layer.bi[t - 1 if j == 0 else 0]
        px, ph = product(wi, u, bi), product(layer.wh, g, layer.bh)
        width, s, out = len(g), layer.shift, []
        for i in range(width):
            z = sigmoid12(round_shift(px[i] + ph[i], s))
            r = sigmoid12(round_shift(px[width + i] + ph[width + i], s))
            kept = round_shift(r * clamp(round_shift(ph[2 * width + i], s), -2047, 2047), 12)
            n = self.state(round_shift(px[2 * width + i], s) + kept)
            out.append(round_shift(z * g[i] + (4096 - z) * n, 12))
        return out

    def history(self, words: list[Vector]) -> Matrix:
        """G_0 .. G_(m-1) of the codewords, as activations, of stages 1 .. m - 1."""
        states = [layer.start for layer in self.gru]
        tops = [states[-1]]
        for t, u in enumerate(words, start=1):
            for j in range(len(self.gru)):
                u = states[j] = self.gru_step(j, t, u, states[j])
            tops.append(u)
        return tops

    def attend(self, h: Vector, tops: Matrix) -> Vector:
        if self.attention is None:
            return tops[-1]
        query, key, value, shift = self.attention
        q = query(h, -127, 127)
        scores = [round_shift(dot(q, key(g, -127, 127)), shift) for g in tops]
        weights = [exp2w(max(scores) - score) for score in scores]
        alpha = [256 * w // sum(weights) for w in weights]
        values = [value(g, -self.amax, self.amax) for g in tops]
        sums = [dot(alpha, column) for column in zip(*values, strict=True)]
        return [round_shift(v, 8) for v in sums]  # the shares sum to at most 256

    def mix(self, h: Vector, words: list[Vector]) -> Vector:
        return self.mixer(h + self.attend(h, self.history(words)), 0, self.amax)


def parse_network(numbers: Numbers) -> Network:
    def counts(most: int, names: str) -> list[int]:
        return [numbers.count(most, name) for name in names.split()]

    bits, flags, latent_shift, codeword_shift = counts(255, "activation_bits flags latent_shift codeword_shift")
    classes, attributes, depths, latents, grid = counts(512, "classes attributes depths latents grid")
    dims, first, hidden, mixed = [*counts(64, "codeword_dims"), *counts(256, "embed_width hidden mixed")]
    layers, tokens, heads = [*counts(4, "gru_count"), *counts(7, "tokens"), *counts(2, "head_count")]
    require(flags < 4, "bad-network")
    inputs = classes + (attributes if flags & 1 else 0) + depths * (attributes + latents + 1) + grid
    require(inputs <= 512, "bad-network")
    network = Network(
        bits, bool(flags & 1), latent_shift, codeword_shift, classes, attributes, depths, latents, grid, dims, tokens,
        (_linear(numbers, first, inputs), _linear(numbers, hidden, first)),
        [_gru(numbers, hidden, dims + 1, heads, tokens) if j == 0 else _gru(numbers, hidden, hidden, 1, 1)
         for j in range(layers)],
        _attention(numbers, hidden) if flags & 2 else None,
        _linear(numbers, mixed, 2 * hidden),
        [_head(numbers, dims + 1, mixed) for _ in range(heads)],
    )
    numbers.seal()
    require(_is_sound(network, inputs), "bad-network")
    return network


def _is_sound(net: Network, inputs: int) -> bool:
    """R-10.5-2 to R-10.5-5, of a network that takes so many inputs."""
    if not 8 <= net.bits <= 12 or net.classes > MAX_CLASSES or not net.gru or not net.heads:
        return False
    if min(inputs, net.dims, *(len(layer.biases) for layer in (*net.embed, net.mixer))) < 1:
        return False
    attention = [net.attention.query, net.attention.key, net.attention.value] if net.attention else []
    projections = [head.project for head in net.heads]
    shifts = [net.latent_shift, net.codeword_shift, *(layer.shift for layer in net.gru)]
    shifts += [head.shift for head in net.heads]
    shifts += [net.attention.shift] if net.attention else []
    exact = all(layer.is_exact(net.amax) for layer in (*net.embed, *attention, net.mixer, *projections))
    exact &= all(_gru_is_exact(layer, net.amax) for layer in net.gru)
    exact &= all(head.biases for head in net.heads)
    return max(shifts) <= 24 and exact and (net.tokens == 0 or len(net.heads) == 2)


def _gru_is_exact(layer: Gru, amax: int) -> bool:
    def reach(matrix: Matrix, biases: Vector) -> int:
        return max((amax * sum(map(abs, row)) + b for row, b in zip(matrix, biases, strict=True)), default=0)

    rows = len(layer.wh)
    most = [max((abs(bi[row]) for bi in layer.bi), default=0) for row in range(rows)]
    sums = [reach(wi, most) for wi in layer.wi] + [reach(layer.wh, [abs(b) for b in layer.bh])]
    return max(sums) + (1 << layer.shift >> 1) < 1 << 23 and all(abs(x) <= amax for x in layer.start)


def check_network(net: Network, books: dict[int, Matrix]) -> None:
    """R-10.5-7: the logits of every head stay in reach."""
    for number, book in books.items():
        require(Coder(net, net.heads[number], book).top.is_exact(net.amax), "bad-network")


def _matrix(numbers: Numbers, rows: int, columns: int) -> Matrix:
    return read_matrix(numbers, rows, columns, "numbers", "bad-network")


def _linear(numbers: Numbers, rows: int, columns: int) -> Linear:
    shift = numbers.count(255, "shift")
    return Linear(_matrix(numbers, rows, columns), numbers.take_shifted(rows, "biases"), shift)


def _gru(numbers: Numbers, hidden: int, columns: int, matrices: int, tokens: int) -> Gru:
    shift, rows = numbers.count(255, "shift"), 3 * hidden
    wi = [_matrix(numbers, rows, columns) for _ in range(matrices)]
    wh = _matrix(numbers, rows, hidden)
    biases = numbers.take_shifted(tokens * rows, "bi")
    bi = [biases[t * rows : (t + 1) * rows] for t in range(tokens)]
    return Gru(shift, wi, wh, bi, numbers.take_shifted(rows, "bh"), numbers.take_shifted(hidden, "start"))


def _attention(numbers: Numbers, hidden: int) -> Attention:
    query, key_, value = (_linear(numbers, hidden, hidden) for _ in range(3))
    return Attention(query, key_, value, numbers.count(255, "score_shift"))


def _head(numbers: Numbers, dims: int, mixed: int) -> Head:
    size, project = numbers.count(4096, "size"), _linear(numbers, dims, mixed)
    return Head(project, numbers.count(255, "shift"), numbers.take_shifted(size, "biases"))


def frequencies(logits: Vector) -> list[int]:
    """Cumulative frequencies of logits."""
    return cumulative([exp2w(max(logits) - logit) for logit in logits])


class Coder:
    """Head and codewords of one codebook."""

    def __init__(self, network: Network, head: Head, book: Matrix) -> None:
        self.network, self.project = network, head.project
        self.words = [network.activations(word) for word in book]
        self.top = Linear(self.words, head.biases, head.shift)

    def logits(self, y: Vector) -> Vector:
        """Logits of all codewords."""
        o, top = self.project(y, -self.network.amax, self.network.amax), self.top
        return [round_shift(v, top.shift) for v in product(top.weights, o, top.biases)]

    def read(self, rans: Rans, y: Vector) -> int:
        """The index of the anchor with this y."""
        logits = self.logits(y)
        return rans.symbol(Table(range(len(logits)), frequencies(logits)))
