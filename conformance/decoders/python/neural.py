"""The neural entropy model of the second decoder: SPEC.md §10 in Python integers, standard library only.

Written from the text, function by function, without a look at how the package does it: nothing here is fast. A vector
is a list of int, a matrix a list of rows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from conformance.decoders.python.fields import Payload, Rans, Table, cumulative, require

Vector = list[int]
Matrix = list[Vector]

ATTRIBUTES = (5, 6, 7, 8)
MAX_CLASSES = 15

# ---------------------------------------------------------------------------------------------- 10.1 arithmetic

# No entry comes within 0.0004 of a half: the printed tables and every machine's formulas agree (tests compare them).
TANH = [round(2047 * math.tanh(u / 32)) for u in range(256)]
SIGMOID = [round(4096 / (1 + math.exp(-u / 32))) for u in range(256)]
EXP2 = [round(65536 * 2 ** (-f / 32)) for f in range(32)]


def round_shift(v: int, s: int) -> int:
    return (v + (1 << s >> 1)) >> s


def clamp(v: int, low: int, high: int) -> int:
    return min(max(v, low), high)


def tanh12(u: int) -> int:
    t = TANH[min(abs(u), 255)]
    return t if u >= 0 else -t


def sigmoid12(u: int) -> int:
    t = SIGMOID[min(abs(u), 255)]
    return t if u >= 0 else 4096 - t


def exp2w(d: int) -> int:
    return 0 if d > 511 else EXP2[d % 32] >> (d // 32)


def dot(a: Sequence[int], b: Sequence[int]) -> int:
    return sum(x * y for x, y in zip(a, b, strict=True))


def product(matrix: Matrix, x: Vector, biases: Vector) -> Vector:
    return [dot(row, x) + b for row, b in zip(matrix, biases, strict=True)]


class Linear(NamedTuple):
    """A linear layer."""

    weights: Matrix
    biases: Vector
    shift: int

    def rounded(self, x: Vector) -> Vector:
        return [round_shift(v, self.shift) for v in product(self.weights, x, self.biases)]

    def __call__(self, x: Vector, low: int, high: int) -> Vector:
        return [clamp(v, low, high) for v in self.rounded(x)]


# ---------------------------------------------------------------------------------------------- 10.2 context


def fine(v: int, n: int) -> int:
    if n == 0:
        return 0
    power: int = 3 ** (n - 1)
    return clamp((2048 * v + power) // (2 * power), -(1 << 24), 1 << 24)


class Context:
    """The anchors known in one layer of one tile, and how they are summed up."""

    def __init__(self, codes: Vector, bits: int, targets: Sequence[int], passes_log2: int) -> None:
        self.codes = codes
        self.rank = {a: r for r, a in enumerate(sorted(range(len(codes)), key=lambda a: (codes[a], a)))}
        self.passes_log2 = passes_log2
        self.depths = [self._depth(bits, t) for t in targets]

    def _depth(self, bits: int, target: int) -> int:
        for e in range(bits):
            if len({code >> 3 * e for code in self.codes}) * target <= len(self.codes):
                return e
        return bits

    def passes(self, group: Vector) -> list[Vector]:
        group = sorted(group, key=self.rank.__getitem__)
        p = 1 << self.passes_log2
        out = [group[::p]]
        while p > 1:
            out.append(group[p // 2 :: p])
            p //= 2
        return out

    def cells(self, columns: int) -> Cells:
        return Cells(self, columns)


class Cells:
    """The collection E: sums of its rows in every cell of every depth."""

    def __init__(self, context: Context, columns: int) -> None:
        self.context = context
        self.columns = columns
        self.sums: list[dict[int, tuple[int, Vector]]] = [{} for _ in context.depths]

    def add(self, a: int, row: Vector) -> None:
        for e, cells in zip(self.context.depths, self.sums, strict=True):
            cell = self.context.codes[a] >> 3 * e
            n, sums = cells.get(cell, (0, [0] * self.columns))
            cells[cell] = n + 1, [s + v for s, v in zip(sums, row, strict=True)]

    def around(self, a: int) -> tuple[Matrix, Vector]:
        means, counts = [], []
        before = [0] * self.columns
        for e, cells in zip(self.context.depths, self.sums, strict=True):
            n, sums = cells.get(self.context.codes[a] >> 3 * e, (0, []))
            if n > 0:
                before = [(2 * s + n) // (2 * n) for s in sums]
            means.append(before)
            counts.append(32 * min(n.bit_length(), 8))
        return means, counts


# ---------------------------------------------------------------------------------------------- 10.3 predictors

Key = tuple[int, int, int]


class Predictor(NamedTuple):
    """A predictor of one (stream, component, step)."""

    buckets: tuple[int, int]
    hidden: Linear | None
    output: Linear

    def context(self, x: Vector) -> int:
        z = self.hidden(x, 0, 511) if self.hidden else []
        o0, o1 = self.output.rounded(x + z)
        b1, b2 = self.buckets
        return clamp(o0, 0, b1 - 1) * b2 + clamp(o1, 0, b2 - 1)


def parse_predictors(block: bytes) -> dict[Key, Predictor]:
    reader, out = Payload(block), {}
    count = reader.count(1024)
    require(count > 0, "bad-predictor")
    for _ in range(count):
        stream, component, step, b1, b2, classes, inputs, units = reader.fields("8B")
        sane = stream in ATTRIBUTES and classes <= MAX_CLASSES < inputs and units <= 64
        require(sane, "bad-predictor")
        hidden = _stored_layer(reader, units, inputs, classes) if units else None
        output = _stored_layer(reader, 2, inputs + units, classes)
        out[stream, component, step] = Predictor((b1 + 1, b2 + 1), hidden, output)
    reader.finish()
    return out


def _stored_layer(reader: Payload, rows: int, columns: int, classes: int) -> Linear:
    shift = reader.u8()
    missing = [0] * (MAX_CLASSES - classes)
    kept = _matrix(reader, rows, columns - len(missing), "bad-predictor")
    weights = [row[:classes] + missing + row[classes:] for row in kept]
    return Linear(weights, reader.shifted(rows), shift)


def _matrix(reader: Payload, rows: int, columns: int, refusal: str) -> Matrix:
    weights = reader.rice(rows * columns)
    require(all(abs(w) <= 32767 for w in weights), refusal)
    return [weights[r * columns : (r + 1) * columns] for r in range(rows)]


@dataclass(frozen=True)
class StepInputs:
    """What the predictors of one step of one channel read of an anchor.

    Attributes:
        klass: its class.
        before: fine values of the attribute channels before this one, after this layer.
        fine0: those of this channel after n - 1 steps.
        first: first-step values of this channel, for step 1.
        step: n.
    """

    klass: int
    before: Vector
    fine0: Vector
    first: Vector
    step: int

    def of(self, j: int, around: tuple[Matrix, Vector]) -> Vector:
        means, counts = around
        x = [64 * (c == self.klass) for c in range(MAX_CLASSES)]
        x += [v >> 6 for v in self.before]
        for c, v in enumerate(self.fine0):
            x.append((fine(self.first[c], 1) if self.step == 1 and c < j else v) >> 6)
        x += [m >> 6 for row in means for m in row]
        x += counts
        for row in means:
            x.append(round_shift((row[j] - self.fine0[j]) * 3 ** (self.step - 1), 5))
        return [clamp(v, -511, 511) for v in x]


# ---------------------------------------------------------------------------------------------- 10.5 index network


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

    clusters: Vector
    projections: list[Linear]
    shift: int
    member_shift: int
    cluster_biases: Vector
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
        return [clamp(round_shift(v, 8), -self.amax, self.amax) for v in sums]

    def mixed(self, h: Vector, words: list[Vector]) -> Vector:
        return self.mixer(h + self.attend(h, self.history(words)), 0, self.amax)

    def logits(self, project: Linear, vectors: Matrix, biases: Vector, shift: int, y: Vector) -> Vector:
        o = project(y, -self.amax, self.amax)
        return [round_shift(v, shift) for v in product(vectors, o, biases)]


def parse_network(block: bytes) -> Network:
    reader = Payload(block)
    bits, flags, latent_shift, codeword_shift = reader.fields("4B")
    require(flags < 4, "bad-network")
    classes, attributes, depths, latents, grid = (reader.count(512) for _ in range(5))
    dims, first, hidden, mixed = reader.count(64), reader.count(256), reader.count(256), reader.count(256)
    layers, tokens, heads = reader.count(4), reader.count(7), reader.count(2)
    inputs = classes + (attributes if flags & 1 else 0) + depths * (attributes + latents + 1) + grid
    require(inputs <= 512, "bad-network")
    network = Network(
        bits, bool(flags & 1), latent_shift, codeword_shift, classes, attributes, depths, latents, grid, dims,
        (_linear(reader, first, inputs), _linear(reader, hidden, first)),
        [_gru(reader, hidden, dims + 1, heads, tokens) if j == 0 else _gru(reader, hidden, hidden, 1, 1)
         for j in range(layers)],
        _attention(reader, hidden) if flags & 2 else None,
        _linear(reader, mixed, 2 * hidden),
        [_head(reader, dims + 1, mixed) for _ in range(heads)],
    )
    reader.finish()
    require(classes <= MAX_CLASSES, "bad-network")
    return network


def _linear(reader: Payload, rows: int, columns: int) -> Linear:
    shift = reader.u8()
    weights = _matrix(reader, rows, columns, "bad-network")
    return Linear(weights, reader.shifted(rows), shift)


def _gru(reader: Payload, hidden: int, columns: int, matrices: int, tokens: int) -> Gru:
    shift, rows = reader.u8(), 3 * hidden
    wi = [_matrix(reader, rows, columns, "bad-network") for _ in range(matrices)]
    wh = _matrix(reader, rows, hidden, "bad-network")
    biases = reader.shifted(tokens * rows)
    bi = [biases[t * rows : (t + 1) * rows] for t in range(tokens)]
    return Gru(shift, wi, wh, bi, reader.shifted(rows), reader.shifted(hidden))


def _attention(reader: Payload, hidden: int) -> Attention:
    query, key_, value = (_linear(reader, hidden, hidden) for _ in range(3))
    return Attention(query, key_, value, reader.u8())


def _head(reader: Payload, dims: int, mixed: int) -> Head:
    size = reader.count(4096)
    clusters = [reader.count(4096) for _ in range(reader.count(256))]
    projections = [_linear(reader, dims, mixed) for _ in range(2 if clusters else 1)]
    shift, member_shift = reader.fields("2B")
    cluster_biases = reader.shifted(len(clusters))
    return Head(clusters, projections, shift, member_shift, cluster_biases, reader.shifted(size))


def frequencies(logits: Vector) -> list[int]:
    """Cumulative frequencies of logits."""
    return cumulative([exp2w(max(logits) - logit) for logit in logits])


class Coder:
    """Head and codewords of one codebook."""

    def __init__(self, network: Network, head: Head, book: Matrix) -> None:
        self.network, self.head = network, head
        self.words = [network.activations(word) for word in book]
        self.starts = [sum(head.clusters[:i]) for i in range(len(head.clusters))]
        self.centroids, self.deviations = [], []
        for start, size in zip(self.starts, head.clusters, strict=True):
            part = self.words[start : start + size]
            centroid = [sum(column) // size for column in zip(*part, strict=True)]
            self.centroids.append(centroid)
            self.deviations.append([[e - c for e, c in zip(word, centroid, strict=True)] for word in part])

    def top(self, y: Vector) -> Vector:
        """Logits of all codewords of a flat head, of all clusters of a two-level one."""
        head = self.head
        vectors, biases = (self.centroids, head.cluster_biases) if head.clusters else (self.words, head.biases)
        return self.network.logits(head.projections[0], vectors, biases, head.shift, y)

    def members(self, i: int, y: Vector) -> Vector:
        """Logits of the codewords of cluster i."""
        head, start = self.head, self.starts[i]
        biases = head.biases[start : start + head.clusters[i]]
        return self.network.logits(head.projections[1], self.deviations[i], biases, head.member_shift, y)

    def read(self, rans: Rans, ys: list[Vector]) -> Vector:
        """The index of each of the anchors with these y."""
        def symbol(logits: Vector) -> int:
            return rans.symbol(Table(range(len(logits)), frequencies(logits)))

        first = [symbol(self.top(y)) for y in ys]
        if not self.head.clusters:
            return first
        index = [0] * len(ys)
        for i, start in enumerate(self.starts):
            for e, y in enumerate(ys):
                if first[e] == i:
                    index[e] = start + symbol(self.members(i, y))
        return index


@dataclass
class IndexReader:
    """The indices of one layer of one tile.

    Attributes:
        network, books: the index network and the codebooks by number.
        context: of the tile-layer.
        classes: of the anchors.
        fine: per anchor, fine values of the attribute channels after this layer.
        grid: features of an anchor; none without a grid.
        embedded: h of every anchor coded, in coding order, once they are read.
        tables: of the first symbol of each stage, once they are read.
    """

    network: Network
    books: dict[int, Matrix]
    context: Context
    classes: Vector
    fine: Matrix
    grid: Callable[[int], Vector] | None
    embedded: Matrix = field(default_factory=list)
    tables: dict[int, Table] = field(default_factory=dict)

    def read(self, rans: Rans, index: Matrix, before: Vector, after: Vector) -> None:
        """Into index[a][stage], stages from 1."""
        net = self.network
        coders = {b: Coder(net, head, self.books[b]) for b, head in enumerate(net.heads) if b in self.books}
        sums = self.context.cells(net.attributes + net.latents)
        for a, stages in enumerate(before):
            if stages > 0:
                sums.add(a, self._row(index[a], a, stages))
        for part in self.context.passes([a for a in range(len(before)) if before[a] < after[a]]):
            h = {a: net.embedding(self._inputs(sums, a)) for a in part}
            self.embedded += h.values()
            for stage in range(1, 9):
                chosen = [a for a in part if before[a] < stage <= after[a]]
                ys = [net.mixed(h[a], self._words(coders, index[a], stage)) for a in chosen]
                rans.forget()
                values = coders[min(stage - 1, 1)].read(rans, ys) if chosen else []
                if rans.first:
                    self.tables.setdefault(stage, rans.first)
                for a, value in zip(chosen, values, strict=True):
                    index[a][stage] = value
            for a in part:
                sums.add(a, self._row(index[a], a, after[a]))

    def _words(self, coders: dict[int, Coder], index: Vector, stage: int) -> list[Vector]:
        return [coders[min(t - 1, 1)].words[index[t]] for t in range(1, stage)]

    def _row(self, index: Vector, a: int, stages: int) -> Vector:
        words = [self.books[min(t - 1, 1)][index[t]] for t in range(1, stages + 1)]
        return self.fine[a] + [sum(word[c] for word in words) for c in range(self.network.latents)]

    def _inputs(self, sums: Cells, a: int) -> Vector:
        net = self.network
        means, counts = sums.around(a)
        x = [64 * (c == self.classes[a]) for c in range(net.classes)]
        x += [v >> 6 for v in self.fine[a]] if net.own else []
        for row, count in zip(means, counts, strict=True):
            x += [m >> 6 for m in row[: net.attributes]]
            x += [round_shift(m, net.latent_shift) for m in row[net.attributes :]]
            x.append(count)
        x += self.grid(a) if self.grid else []
        return [clamp(v, -net.amax, net.amax) for v in x]


# ---------------------------------------------------------------------------------------------- 10.6 hash grid

PLANES = ((0, 1, 2), (0, 1), (0, 2), (1, 2), (0,), (1,), (2,))
PRIMES = (1, 2654435761, 805459861)


class Level(NamedTuple):
    """One level of a hash grid."""

    axes: tuple[int, ...]
    resolution: int
    table_log2: int
    features: int

    @property
    def vertices(self) -> int:
        return math.prod([self.resolution + 1] * len(self.axes))

    @property
    def dense(self) -> bool:
        return self.vertices <= 1 << self.table_log2

    @property
    def entries(self) -> int:
        return self.vertices if self.dense else 1 << self.table_log2

    def entry(self, vertex: Vector) -> int:
        if self.dense:
            return sum(n * (self.resolution + 1) ** d for d, n in enumerate(vertex))
        hashed = 0
        for n, prime in zip(vertex, PRIMES, strict=False):
            hashed ^= n * prime
        return hashed % (1 << self.table_log2)


class Grid(NamedTuple):
    """A HASH_GRID block."""

    origin: Vector
    extent_bits: int
    levels: list[tuple[Level, Vector]]

    def features(self, point: Vector) -> Vector:
        """Of an anchor whose cell has this middle, in lattice steps."""
        k, out = self.extent_bits, []
        q = [clamp(p - o, 0, (1 << k) - 1) for p, o in zip(point, self.origin, strict=True)]
        for level, bits in self.levels:
            x = [q[axis] * level.resolution for axis in level.axes]
            cell = [v >> k for v in x]
            part = [(v >> (k - 8) if k >= 8 else v << (8 - k)) & 255 for v in x]
            sums = [0] * level.features
            for corner in range(1 << len(x)):
                up = [corner >> d & 1 for d in range(len(x))]
                weight = math.prod(f if u else 256 - f for f, u in zip(part, up, strict=True))
                start = level.entry([c + u for c, u in zip(cell, up, strict=True)]) * level.features
                for feature, bit in enumerate(bits[start : start + level.features]):
                    sums[feature] += weight if bit else -weight
            out += [clamp(round_shift(s, 8 * len(x) - 7), -127, 127) for s in sums]
        return out


def parse_grid(block: bytes) -> Grid:
    reader = Payload(block)
    origin, extent_bits = [reader.varint(32) for _ in range(3)], reader.varint(32)
    shapes = [[reader.varint(32) for _ in range(4)] for _ in range(reader.count(16))]
    require(all(shape[0] < len(PLANES) for shape in shapes), "bad-grid")
    levels = []
    for plane, *shape in shapes:
        level = Level(PLANES[plane], *shape)
        ones = reader.u8()
        require(ones > 0, "bad-grid")
        rans = Rans(reader.take(reader.fields("I")[0]), {})
        table = Table((0, 1), cumulative([256 - ones, ones]))
        levels.append((level, [rans.symbol(table) for _ in range(level.entries * level.features)]))
        rans.seal()
    reader.finish()
    return Grid(origin, extent_bits, levels)
