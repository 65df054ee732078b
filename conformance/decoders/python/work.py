"""The work a file declares: SPEC §13.2, function by function, of what the decoder has read."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple

from conformance.decoders.python.fields import OFFSETS

if TYPE_CHECKING:
    from conformance.decoders.python.decoder import Decoder

Declared = list[tuple[int, int, int]]
"""Layer, tile and count of every TILE block."""


class Parts(NamedTuple):
    """The terms of work(k): three sums, the anchors after layer k, and the work of each of the dearest class."""

    models: int
    splits: int
    tiles: int
    anchors: int
    an_anchor: int

    @property
    def total(self) -> int:
        """work(k)."""
        return self.models + self.splits + self.tiles + self.anchors * self.an_anchor


class Work:
    """The functions of §13.2 for the layers 1..k of a file.

    Args:
        decoder: of the file, to layer k.
    """

    def __init__(self, decoder: Decoder) -> None:
        self.d = decoder
        self.k = decoder.k
        self.networks = decoder.networks

    def total(self, declared: Declared | None = None) -> int:
        """work(k); `declared` in place of what the directory says."""
        return self.parts(declared).total

    def parts(self, declared: Declared | None = None) -> Parts:
        """The terms of work(k); `declared` replaces the counts of the directory."""
        if declared is None:
            declared = [(layer, tile, count) for (layer, kind, tile), (_, count) in self.d.blocks.items() if kind == 16]
        declared = [row for row in declared if row[0] <= self.k and row[2] > 0]
        models = (1 << 17) * len(self.d.tables[-1]) + (1 << 6) * self._grid_bits()
        models += sum(map(len, self.d.books.values())) * self._recurrent()
        splits = tiles = 0
        for _, tile, count in declared:
            depth, shift = self.d.tiles[tile][:2]
            splits += (1 << 16) * 3 * (self.d.lattice_bits - depth - shift) * min(count - 1, 16)
        for j in range(1, self.k + 1):
            tiles += len({tile for layer, tile, _ in declared if layer <= j}) * self.tile_work(j)
        classes = range(self.d.classes(self.k))
        dearest = max(sum(self.anchor_work(c, j) for j in range(1, self.k + 1)) for c in classes)
        anchors = sum(count for _, _, count in declared)
        return Parts(models, splits, tiles, anchors, self.result_work() + dearest)

    def _grid_bits(self) -> int:
        return sum(level.entries * level.features for level, _ in self.d.grid.levels) if self.d.grid else 0

    def _recurrent(self) -> int:
        gru = self.d.network.gru if self.d.network else []
        return sum(_size(layer.wi[0]) + _size(layer.wh) for layer in gru)

    def tile_work(self, j: int) -> int:
        """Beginning layer j of one tile."""
        gained = {
            (channel.stream, n)
            for i, channel in enumerate(self.d.channels)
            for c in range(self.d.classes(j))
            for n in range(self.d.steps(j - 1, i, c) + 1, self.d.steps(j, i, c) + 1)
        }
        tables = 0
        for number in self.d.tables[j - 1]:
            stream, step = number >> 24, number >> 8 & 255
            tables += step == 0 or stream == OFFSETS or (stream, step) in gained
        passes = self.d.opening.passes_log2 + 1
        predicted = len({(stream, n) for stream, _, n in self.d.predictors[j - 1]} & gained)
        total = (1 << 21) + (1 << 15) * tables * (passes if predicted else 1) + (1 << 21) * passes * predicted
        if self.d.rows[j - 1].mode == 1 and self.d.network:
            stages = max(self.d.stages(j, c) for c in range(self.d.classes(j)))
            total += stages * passes * (1 << 23)
        return total

    def anchor_work(self, c: int, j: int) -> int:
        """One anchor of class c in layer j; nothing before the class appears."""
        if c >= self.d.classes(j):
            return 0
        symbols = 1 + len(self.d.channels)
        predicted = 0
        for i, channel in enumerate(self.d.channels):
            before, after = self.d.steps(j - 1, i, c), self.d.steps(j, i, c)
            symbols += (after - before) * channel.components
            for (stream, _, n), predictor in self.d.predictors[j - 1].items():
                if stream == channel.stream and before < n <= after:
                    units = len(predictor.hidden.weights) if predictor.hidden else 0
                    inputs = len(predictor.output.weights[0]) - units
                    predicted += (units + 2) * inputs + 2 * units + (1 << 4) * inputs
        if self.d.profile:
            symbols += self.d.slots * (4 if c >= self.d.classes(j - 1) else 1)
        return (1 << 8) * symbols + predicted + self._index_work(c, j)

    def _index_work(self, c: int, j: int) -> int:
        gained = self.d.stages(j, c) - self.d.stages(j - 1, c)
        if gained == 0:
            return 0
        if self.d.rows[j - 1].mode == 0 or self.d.network is None:
            return (1 << 8) * gained
        most = max(len(head.biases) for head in self.d.network.heads)
        return self._products(self.d.stages(j, c)) + gained * ((1 << 8) + (1 << 4) * most)

    def _products(self, s: int) -> int:
        net = self.d.network
        assert net is not None
        heads = [_size(head.project.weights) + (net.dims + 1) * len(head.biases) for head in net.heads]
        total = sum(_size(layer.weights) for layer in net.embed) + s * _size(net.mixer.weights)
        total += (s - 1) * self._recurrent() + heads[0] + (s - 1) * heads[-1]
        if net.attention:
            hidden = len(net.mixer.weights[0]) // 2
            total += _size(net.attention.query.weights) + 2 * s * _size(net.attention.key.weights)
            total += s * (s + 1) * hidden
        return total

    def result_work(self) -> int:
        """The work of every anchor for the result."""
        total = (1 << 4) * sum(channel.components for channel in self.d.channels)
        for shape in self.networks:
            total += 2 * sum(rows * columns for rows, columns in shape)
            total += (1 << 4) * (max(rows for rows, _ in shape) + shape[0][1])
        return total + ((1 << 11) * self.networks[0][-1][0] if self.networks else 0)


def _size(matrix: Iterable[list[int]]) -> int:
    return sum(map(len, matrix))
