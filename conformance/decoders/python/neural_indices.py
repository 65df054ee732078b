"""The indices of a layer of a tile in entropy mode 1 (SPEC §10.4, §10.5)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from conformance.decoders.python.arithmetic import Matrix, Vector, clamp, round_shift
from conformance.decoders.python.context import Cells, Context
from conformance.decoders.python.fields import Rans, Table
from conformance.decoders.python.index_network import Coder, Network


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
                rans.forget()
                for a in chosen:
                    y = net.mix(h[a], self._words(coders, index[a], stage))
                    index[a][stage] = coders[min(stage - 1, 1)].read(rans, y)
                if rans.first:
                    self.tables.setdefault(stage, rans.first)
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
