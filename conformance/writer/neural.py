"""Symbols that the neural entropy model codes: steps with predictors, and indices in entropy mode 1 (SPEC §10).

The networks are those of the blocks written, evaluated by the second decoder, which was written
from SPEC.md, too; the order of symbols is written here once more, from the side that knows them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from conformance.decoders.python.arithmetic import Matrix, Vector, clamp, round_shift
from conformance.decoders.python.context import Cells, Context, fine
from conformance.decoders.python.fields import key
from conformance.decoders.python.hash_grid import Grid
from conformance.decoders.python.index_network import Coder, Network, frequencies
from conformance.decoders.python.predictors import ATTRIBUTES, Predictor, StepInputs
from conformance.writer.anchors import Anchors
from conformance.writer.contexts import step_symbols, table_contexts
from conformance.writer.substream import Substream

MAX_STAGES = 8
CLASS_INPUT = 64


@dataclass(frozen=True)
class Models:
    """The neural models in force in a layer.

    Attributes:
        predictors: by stream, component, step.
        network, grid: None before the first layer of entropy mode 1.
        books: codebooks by number.
    """

    predictors: Mapping[tuple[int, int, int], Predictor] = field(default_factory=dict)
    network: Network | None = None
    grid: Grid | None = None
    books: Mapping[int, Matrix] = field(default_factory=dict)

    @cached_property
    def coders(self) -> dict[int, Coder]:
        """Head and codewords by number of the codebook."""
        assert self.network is not None
        heads = enumerate(self.network.heads)
        return {b: Coder(self.network, head, self.books[b]) for b, head in heads if b in self.books}


class Seen:
    """The decoded context of one layer of one tile (SPEC §10.2).

    Args:
        bits: local bits of the tile.
    """

    def __init__(self, anchors: Anchors, bits: int) -> None:
        self.anchors = anchors
        self.bits = bits

    @cached_property
    def context(self) -> Context:
        """Depths and passes."""
        context = self.anchors.model.context
        return Context(self.anchors.codes, self.bits, context.occupancies, context.passes_log2)

    def fine(self, i: int, layer: int) -> Matrix:
        """Fine values of a channel after a layer, per anchor."""
        steps = self.anchors.steps(layer, i)
        return [[fine(v, n) for v in self.anchors.at(i, n)[a]] for a, n in enumerate(steps)]

    def attributes(self, past: int) -> Matrix:
        """Fine values of the attribute channels below channel `past` after this layer, per anchor."""
        chosen = [i for i in range(past) if self.anchors.model.channels[i].stream in ATTRIBUTES]
        columns = [self.fine(i, self.anchors.layer) for i in chosen]
        return [[v for rows in columns for v in rows[a]] for a in range(len(self.anchors.codes))]


def put_predicted_step(out: Substream, seen: Seen, step: tuple[int, int], chosen: list[int], models: Models) -> None:
    """Step n of channel i of the anchors chosen, where a component has a predictor (SPEC §10.3)."""
    (i, n), anchors = step, seen.anchors
    stream, components = int(anchors.model.channels[i].stream), anchors.model.channels[i].components
    settled, earlier = seen.attributes(i), seen.fine(i, anchors.layer - 1)
    sums = seen.context.cells(components)
    for a, steps in enumerate(anchors.steps(anchors.layer - 1, i)):
        if steps >= n:
            sums.add(a, earlier[a])
    here, coarser = anchors.at(i, n), anchors.at(i, n - 1)
    for part in seen.context.passes(chosen):
        around = {a: sums.around(a) for a in part}
        inputs = {
            a: StepInputs(anchors.classes[a], settled[a], [fine(v, n - 1) for v in coarser[a]], here[a], n)
            for a in part
        }
        for j in range(components):
            predictor = models.predictors.get((stream, j, n))
            if predictor is None:
                contexts = table_contexts(anchors, (i, j, n), part)
            else:
                contexts = [predictor.context(inputs[a].of(j, around[a])) for a in part]
            out.put_by_context(key(stream, j, n, 0), contexts, step_symbols(anchors, (i, j, n), part))
        for a in part:
            sums.add(a, [fine(v, n) for v in here[a]])


def put_neural_indices(out: Substream, seen: Seen, models: Models, lattice_bits: int) -> None:
    """INDICES of a layer of entropy mode 1 (SPEC §10.5)."""
    indices = _Indices(seen, models, lattice_bits)
    anchors, net = seen.anchors, indices.network
    before, after = anchors.stages(anchors.layer - 1), anchors.stages(anchors.layer)
    sums = seen.context.cells(net.attributes + net.latents)
    for a, stages in enumerate(before):
        if stages > 0:
            sums.add(a, indices.row(a, stages))
    for part in seen.context.passes([a for a in range(len(before)) if before[a] < after[a]]):
        h = {a: net.embedding(indices.inputs(sums, a)) for a in part}
        for stage in range(1, MAX_STAGES + 1):
            chosen = [a for a in part if before[a] < stage <= after[a]]
            if chosen:
                ys = [net.mixed(h[a], indices.words(a, stage)) for a in chosen]
                coder = models.coders[min(stage - 1, 1)]
                _put_stage(out, coder, ys, [anchors.index[a][stage] for a in chosen])
        for a in part:
            sums.add(a, indices.row(a, after[a]))


def _put_stage(out: Substream, coder: Coder, ys: list[Vector], indices: Vector) -> None:
    """The indices of one stage: of a two-level head all clusters, then the members cluster by cluster."""
    clusters = coder.head.clusters
    owners = [i for i, size in enumerate(clusters) for _ in range(size)]
    for y, index in zip(ys, indices, strict=True):
        out.put_listed(frequencies(coder.top(y)), [owners[index] if clusters else index])
    for i, start in enumerate(coder.starts):
        for y, index in zip(ys, indices, strict=True):
            if owners[index] == i:
                out.put_listed(frequencies(coder.members(i, y)), [index - start])


class _Indices:
    """The inputs that the index network reads of the anchors of a tile."""

    def __init__(self, seen: Seen, models: Models, lattice_bits: int) -> None:
        assert models.network is not None
        self.network = models.network
        self.models = models
        self.anchors = seen.anchors
        self.lattice_bits = lattice_bits
        self.settled = seen.attributes(len(seen.anchors.model.channels))

    def words(self, a: int, stage: int) -> list[Vector]:
        """Codewords, as activations, of the stages before."""
        coders, index = self.models.coders, self.anchors.index[a]
        return [coders[min(t - 1, 1)].words[index[t]] for t in range(1, stage)]

    def row(self, a: int, stages: int) -> Vector:
        """The numbers that an anchor adds to the cells it lies in."""
        books, index = self.models.books, self.anchors.index[a]
        words = [books[min(t - 1, 1)][index[t]] for t in range(1, stages + 1)]
        return self.settled[a] + [sum(word[c] for word in words) for c in range(self.network.latents)]

    def inputs(self, sums: Cells, a: int) -> Vector:
        """index_inputs of SPEC §10.5."""
        net = self.network
        means, counts = sums.around(a)
        x = [CLASS_INPUT * (c == self.anchors.classes[a]) for c in range(net.classes)]
        x += [v >> 6 for v in self.settled[a]] if net.own else []
        for row, count in zip(means, counts, strict=True):
            x += [m >> 6 for m in row[: net.attributes]]
            x += [round_shift(m, net.latent_shift) for m in row[net.attributes :]]
            x.append(count)
        x += self._grid_features(a)
        return [clamp(v, -net.amax, net.amax) for v in x]

    def _grid_features(self, a: int) -> Vector:
        if self.models.grid is None:
            return []
        tile = self.anchors.tile
        middle = []
        for axis in range(3):
            corner, local = _coordinate(tile.prefix, axis) << self.lattice_bits - tile.depth, self.anchors.codes[a]
            middle.append(corner + (_coordinate(local, axis) << tile.shift) + (1 << tile.shift >> 1))
        return self.models.grid.features(middle)


def _coordinate(code: int, axis: int) -> int:
    return sum((code >> (3 * bit + axis) & 1) << bit for bit in range(21))
