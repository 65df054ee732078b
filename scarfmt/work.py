"""How much work a file asks for, told before a tile is decoded (SPEC §13.2).

A symbol can cost no byte, and a network may look at much for each: the bytes of a file do not bound the time it takes.
What its header, directory and models declare does. Work is counted in multiply-adds; other things count as many as
take about as long.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scarfmt.codecs.codebooks import Codebooks
from scarfmt.codecs.mlp import Network
from scarfmt.directory import Table
from scarfmt.errors import LimitExceeded
from scarfmt.limits import FREE_WORK, Limits
from scarfmt.model import SceneModel
from scarfmt.neural.grid import HashGrid
from scarfmt.neural.network import IndexNetwork
from scarfmt.neural.predictors import Predictor
from scarfmt.schema import BlockKind, Profile

I64 = NDArray[np.int64]

SYMBOL = 1 << 8
"""One symbol from a table."""
GROUP = 1 << 15
"""Opening one table for a group of symbols."""
RECORD = 1 << 16
"""Reading one table record."""
TILE_LAYER = 1 << 20
"""Beginning one layer of one tile."""
STAGE_PASS = 1 << 22
"""Beginning one stage of one pass of the index network."""
NUMBER = 1 << 5
"""Making one number of the result, or one frequency."""
BIT = 1 << 6
"""One bit of a hash grid."""


def tile_layers(directory: Table, layers: int) -> tuple[I64, int]:
    """Per layer, (layers,) tiles that have anchors after it; and the anchors after the last of them."""
    rows = directory[(directory["kind"] == BlockKind.TILE) & (directory["layer"] <= layers) & (directory["count"] > 0)]
    order = np.lexsort((rows["layer"], rows["tile"]))
    tiles, first = np.unique(rows["tile"][order], return_index=True)
    starts = np.bincount(rows["layer"][order][first], minlength=layers + 1)[1:] if len(tiles) else np.zeros(layers)
    return np.cumsum(starts).astype(np.int64), int(rows["count"].sum(dtype=np.int64))


class DeclaredWork:
    """The work of decoding a file's first layers, in the terms of SPEC §13.2.

    Args:
        model: of those layers.
        tables: static tables in force in each layer.
        predictors: in force in each layer, by key.
        network, books, grid: of the index network, or None.
        networks: what is applied to every anchor in the end.
    """

    def __init__(
        self,
        model: SceneModel,
        tables: list[int],
        predictors: tuple[dict[tuple[int, int, int], Predictor], ...],
        network: IndexNetwork | None,
        books: Codebooks | None,
        grid: HashGrid | None,
        networks: tuple[Network, ...],
    ) -> None:
        self._model, self._tables, self._predictors = model, tables, predictors
        self._network, self._books, self._grid, self._networks = network, books, grid, networks

    def total(self, tiles: I64, anchors: int) -> int:
        """Work with (layers,) `tiles` that have anchors after each layer, and `anchors` after the last."""
        layers = range(1, len(self._model.layers) + 1)
        started = sum(int(count) * self._of_tile(layer) for layer, count in zip(layers, tiles, strict=True))
        classes = range(self._model.layers[-1].class_count)
        refined = max(sum(self._of_anchor(layer, kind) for layer in layers) for kind in classes)
        return self._once() + started + anchors * (refined + self._of_result())

    def _once(self) -> int:
        bits = sum(level.bits for level in self._grid.levels) if self._grid else 0
        prepared = 0
        if self._network is not None and self._books is not None:
            codewords = sum(self._books.sizes)
            prepared = codewords * sum(gru.inputs[0].size + gru.recurrent.size for gru in self._network.gru)
        return bits * BIT + prepared

    def _of_tile(self, layer: int) -> int:
        row, context = self._model.layers[layer - 1], self._model.context
        looks = bool(self._predictors[layer - 1]) or row.neural
        passes = context.passes_log2 + 1 if looks else 1
        total = TILE_LAYER + GROUP * self._tables[layer - 1] * passes
        if row.neural and self._network is not None:
            total += max(row.stages) * passes * (STAGE_PASS + GROUP * max(len(h.clusters) for h in self._network.heads))
        return total

    def _of_anchor(self, layer: int, kind: int) -> int:
        """Work for an anchor of class `kind` in one layer."""
        model = self._model
        row = model.layers[layer - 1]
        if kind >= row.class_count:
            return 0
        known = layer > 1 and kind < model.layers[layer - 2].class_count
        steps = model.layers[layer - 2].steps[kind] if known else (0,) * len(model.channels)
        stages = model.layers[layer - 2].stages[kind] if known else 0
        symbols = sum(c.components * (b - a) for c, a, b in zip(model.channels, steps, row.steps[kind], strict=True))
        slots = model.slots * (1 if known else 4) if model.profile == Profile.ANCHOR else 0
        received = {c.stream: (a, b) for c, a, b in zip(model.channels, steps, row.steps[kind], strict=True)}
        predicted = sum(
            predictor.multiply_adds + NUMBER * predictor.inputs
            for (stream, _, step), predictor in self._predictors[layer - 1].items()
            if received[predictor.stream][0] < step <= received[predictor.stream][1]
        )
        # Whether or not anything is received, the anchor is looked at, channel by channel.
        looked = SYMBOL * (1 + len(model.channels))
        return looked + SYMBOL * (symbols + slots) + predicted + self._of_indices(row.neural, stages, row.stages[kind])

    def _of_indices(self, neural: bool, before: int, after: int) -> int:
        if before == after:
            return 0
        if not neural or self._network is None:
            return SYMBOL * (after - before)
        logits = max(len(head.clusters) + max(head.clusters) if head.two_level else len(head.biases)
                     for head in self._network.heads)  # fmt: skip
        return self._network.multiply_adds(after) + (after - before) * (2 * SYMBOL + NUMBER * logits)

    def _of_result(self) -> int:
        numbers = sum(channel.components for channel in self._model.channels)
        products = 0
        for network in self._networks:
            products += sum(layer.weights.size for layer in network.layers)
            numbers += max(layer.weights.shape[0] for layer in network.layers) + network.inputs
        return products + NUMBER * numbers


def check_work(work: int, file_length: int, limits: Limits) -> None:
    """Refuse a file that declares more work than its bytes pay for (SPEC §13.2).

    Raises:
        LimitExceeded: ``limit-work``.
    """
    most = FREE_WORK + limits.work_per_byte * file_length
    if work > most:
        message = f"decoding takes {work} multiply-adds, this reader's limit is {most}: raise it if you trust the file"
        raise LimitExceeded("limit-work", message, field="work")
