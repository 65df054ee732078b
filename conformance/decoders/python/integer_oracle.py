"""The index network in Python integers, one anchor at a time (SPEC §10.1 and §10.5, literally).

Nothing here is fast and nothing is shared with the evaluator: tables come from their formulas, sums are loops
over Python integers. Tests compare every other implementation with this one.

A vector is a list of int, a matrix a list of rows.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from scarfmt.neural.arithmetic import Linear
from scarfmt.neural.network import Attention, GruLayer, Head, IndexNetwork

Vector = list[int]
Matrix = list[Vector]

# No value of these lies within 0.0004 of a half, so any libm rounds them alike.
TANH = [round(2047 * math.tanh(u / 32)) for u in range(256)]
SIGMOID = [round(4096 / (1 + math.exp(-u / 32))) for u in range(256)]
EXP2 = [round(65536 * 2 ** (-f / 32)) for f in range(32)]


def round_shift(v: int, s: int) -> int:
    """v / 2^s to the nearest integer, ties up."""
    return v if s == 0 else (v + (1 << (s - 1))) >> s


def clamp(v: int, low: int, high: int) -> int:
    """v brought into low..high."""
    return max(low, min(high, v))


def tanh12(v: int) -> int:
    """11 fraction bits of tanh(v / 32)."""
    size = TANH[min(abs(v), 255)]
    return size if v >= 0 else -size


def sigmoid12(v: int) -> int:
    """12 fraction bits of the logistic function of v / 32."""
    size = SIGMOID[min(abs(v), 255)]
    return size if v >= 0 else 4096 - size


def exp2w(d: int) -> int:
    """16 fraction bits of 2^(-d / 32), d >= 0."""
    return 0 if d > 511 else EXP2[d % 32] >> (d // 32)


def frequencies(logits: Vector) -> Vector:
    """Frequencies, each >= 1 and 2^24 together, of logits in units of 1/32 bit (SPEC §8.1, §10.5)."""
    n, top = len(logits), max(logits)
    prefix = [0]
    for logit in logits:
        prefix.append(prefix[-1] + exp2w(top - logit))
    cumulative = [c * ((1 << 24) - n) // prefix[-1] + i for i, c in enumerate(prefix)]
    return [cumulative[i + 1] - cumulative[i] for i in range(n)]


def dot(a: Iterable[int], b: Iterable[int]) -> int:
    """Sum of products."""
    return sum(x * y for x, y in zip(a, b, strict=True))


def matrix_vector(matrix: Matrix, x: Vector) -> Vector:
    """One sum of products a row."""
    return [dot(row, x) for row in matrix]


def plus(a: Vector, b: Vector) -> Vector:
    """Elementwise sum."""
    return [x + y for x, y in zip(a, b, strict=True)]


def linear(layer: Linear, x: Vector, low: int, high: int) -> Vector:
    """clamp(round_shift(W x + b, s), low, high)."""
    acc = plus(matrix_vector(layer.weights.tolist(), x), layer.biases.tolist())
    return [clamp(round_shift(v, layer.shift), low, high) for v in acc]


class Oracle:
    """The network of one scene.

    Args:
        network: valid, as :meth:`IndexNetwork.check` finds.
        coarse, residual: the codebooks, a list of int lists each.
    """

    def __init__(self, network: IndexNetwork, coarse: Matrix, residual: Matrix) -> None:
        self.network = network
        self.codewords = [[self._activation(word) for word in words] for words in (coarse, residual)]

    def _activation(self, word: Vector) -> Vector:
        """e_k of one codeword: its leading dimensions, then its magnitude."""
        net = self.network
        leading = word[: net.codeword_dims]
        e = [clamp(round_shift(v, net.codeword_shift), -net.amax, net.amax) for v in leading]
        return [*e, min(net.amax, 8 * sum(v * v for v in e).bit_length())]

    def embedding(self, x: Vector) -> Vector:
        """h of the input columns."""
        net = self.network
        x = [clamp(v, -net.amax, net.amax) for v in x]
        return linear(net.embed[1], linear(net.embed[0], x, 0, net.amax), -net.amax, net.amax)

    def histories(self, codes: Vector) -> Matrix:
        """G_0 .. G_(m-1), states of the top layer, after the indices `codes` of stages 1 .. m-1."""
        states: Matrix = [layer.start.tolist() for layer in self.network.gru]
        tops = [states[-1]]
        for stage, code in enumerate(codes, start=1):
            book = 0 if stage == 1 else 1
            below = self.codewords[book][code]
            for number, layer in enumerate(self.network.gru):
                matrix = layer.inputs[book if number == 0 else 0]
                bias = layer.biases[stage - 1 if number == 0 else 0]
                px = plus(matrix_vector(matrix.tolist(), below), bias.tolist())
                below = states[number] = self.gru_state(layer, px, states[number])
            tops.append(below)
        return tops

    def gru_state(self, layer: GruLayer, px: Vector, state: Vector) -> Vector:
        """g' of one recurrent layer."""
        net, s, width = self.network, layer.shift, len(state)
        ph = plus(matrix_vector(layer.recurrent.tolist(), state), layer.recurrent_biases.tolist())
        new = []
        for i in range(width):
            z = sigmoid12(round_shift(px[i] + ph[i], s))
            r = sigmoid12(round_shift(px[width + i] + ph[width + i], s))
            kept = round_shift(r * clamp(round_shift(ph[2 * width + i], s), -2047, 2047), 12)
            t = round_shift(tanh12(round_shift(px[2 * width + i], s) + kept), 12 - net.activation_bits)
            n = clamp(t, -net.amax, net.amax)
            new.append(round_shift(z * state[i] + (4096 - z) * n, 12))
        return new

    def attended(self, attention: Attention, h: Vector, tops: Matrix) -> Vector:
        """c, the weighted mean of the values of all states so far."""
        amax = self.network.amax
        q = linear(attention.query, h, -127, 127)
        scores = [round_shift(dot(q, linear(attention.key, g, -127, 127)), attention.shift) for g in tops]
        values = [linear(attention.value, g, -amax, amax) for g in tops]
        weights = [exp2w(max(scores) - a) for a in scores]
        alpha = [256 * w // sum(weights) for w in weights]
        sums = [dot(alpha, column) for column in zip(*values, strict=True)]
        return [clamp(round_shift(v, 8), -amax, amax) for v in sums]

    def context(self, x: Vector, codes: Vector) -> Vector:
        """y of the stage that follows the indices `codes`."""
        net = self.network
        h, tops = self.embedding(x), self.histories(codes)
        c = tops[-1] if net.attention is None else self.attended(net.attention, h, tops)
        return linear(net.mixer, h + c, 0, net.amax)

    def projection(self, head: Head, y: Vector, number: int) -> Vector:
        """o of a flat head, o1 or o2 of a two-level one."""
        return linear(head.projections[number], y, -self.network.amax, self.network.amax)

    def flat(self, book: int, y: Vector) -> Vector:
        """Frequencies of the codewords of a flat head."""
        head = self.network.heads[book]
        o = self.projection(head, y, 0)
        logits = plus(matrix_vector(self.codewords[book], o), head.biases.tolist())
        return frequencies([round_shift(v, head.shift) for v in logits])

    def _cluster(self, book: int, cluster: int) -> tuple[Matrix, Vector, int]:
        """Codewords of a cluster, their floor mean, and the number of the first."""
        sizes = self.network.heads[book].clusters
        first = sum(sizes[:cluster])
        words = self.codewords[book][first : first + sizes[cluster]]
        return words, [sum(column) // len(words) for column in zip(*words, strict=True)], first

    def clusters(self, book: int, y: Vector) -> Vector:
        """Frequencies of the clusters of a two-level head."""
        head = self.network.heads[book]
        o = self.projection(head, y, 0)
        centroids = [self._cluster(book, i)[1] for i in range(len(head.clusters))]
        logits = plus(matrix_vector(centroids, o), head.cluster_biases.tolist())
        return frequencies([round_shift(v, head.shift) for v in logits])

    def members(self, book: int, y: Vector, cluster: int) -> Vector:
        """Frequencies of the members of a cluster."""
        head = self.network.heads[book]
        o = self.projection(head, y, 1)
        words, centroid, first = self._cluster(book, cluster)
        biases = head.biases.tolist()[first : first + len(words)]
        logits = [dot([e - c for e, c in zip(word, centroid, strict=True)], o) for word in words]
        return frequencies([round_shift(v, head.member_shift) for v in plus(logits, biases)])
