"""The work that a file asks for, known before a tile is decoded (SPEC §13.2).

A symbol can cost no byte, and a network may look at much for each: the bytes of a file do not bound the time it takes.
What its header, directory and models declare does. Work is counted in multiply-adds; other things count as many as
take about as long.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

from scarfmt.arrays import I64
from scarfmt.coding.models import SceneModels
from scarfmt.container.schema import Profile, Stream
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.errors import LimitExceeded
from scarfmt.limits import FREE_NUMBERS, FREE_WORK, Limits
from scarfmt.neural.network import IndexNetwork
from scarfmt.scene.model import LayerRow, SceneModel

SYMBOL = 1 << 8
"""One symbol from a table."""
GROUP = 1 << 15
"""Opening one table for a group of symbols."""
RECORD = 1 << 17
"""Reading one table record."""
TILE_LAYER = 1 << 21
"""Beginning one layer of one tile."""
SPLIT = 1 << 16
"""Splitting a node of a tile at one bit; at most `MOST_SPLITS` nodes of a bit count."""
MOST_SPLITS = 16
PASS = 1 << 21
"""Beginning one pass of a step with predictors."""
STAGE_PASS = 1 << 23
"""Beginning one stage of one pass of the index network."""
PRODUCT = 2
"""A multiply-add of what is applied to every anchor in the end, in binary64."""
NUMBER = 1 << 4
"""Making one number of the result, or one frequency."""
OUTPUT = 1 << 11
"""Keeping one output of the latent decoder: what it is counted for is memory."""
BIT = 1 << 6
"""One bit of a hash grid."""


def _by_step(tables: Sequence[Mapping[TableKey, SymbolTable]]) -> Iterator[Counter[tuple[int, int]]]:
    """Per layer, how many tables of each (stream, step) are in force: a table of a layer stays or is replaced."""
    before: Mapping[TableKey, SymbolTable] = {}
    counts: Counter[tuple[int, int]] = Counter()
    for here in tables:
        if len(here) > len(before):
            counts = counts + Counter((key.stream, key.step) for key in here.keys() - before.keys())
        yield counts
        before = here


def compute_work(models: SceneModels, tiles: I64, anchors: int, splits: int) -> int:
    """The work of decoding a file's first layers with its models, in the terms of SPEC §13.2.

    Args:
        models: of those layers.
        tiles: (layers,) tiles that have anchors after each layer.
        anchors: after the last of them.
        splits: levels of the trees of positions, times the nodes that each may have, up to `MOST_SPLITS`.
    """
    model, tables = models.model, list(_by_step(models.tables))
    layers = range(1, len(model.layers) + 1)
    started = sum(
        int(count) * _of_tile(models, tables[layer - 1], layer)
        for layer, count in zip(layers, tiles, strict=True)
    )
    classes = range(model.layers[-1].class_count)
    refined = max(sum(_of_anchor(models, layer, kind) for layer in layers) for kind in classes)
    once = sum(tables[-1].values()) * RECORD + _of_networks(models)
    return once + started + SPLIT * splits + anchors * (refined + _of_result(models))


def _of_networks(models: SceneModels) -> int:
    """Work for the hash grid and the index network, before anything is decoded with them."""
    bits = sum(level.bits for level in models.grid.levels) if models.grid else 0
    prepared = 0
    if models.network is not None and models.codebooks is not None:
        codewords = sum(models.codebooks.sizes)
        prepared = codewords * sum(gru.inputs[0].size + gru.recurrent.size for gru in models.network.gru)
    return bits * BIT + prepared


def _of_tile(models: SceneModels, tables: Counter[tuple[int, int]], layer: int) -> int:
    """Work for beginning a layer of a tile, in which so many `tables` of each (stream, step) are in force."""
    row, steps = models.model.layers[layer - 1], _steps(models.model, layer)
    passes = models.model.context.passes_log2 + 1
    predicted = {(stream, step) for stream, _, step in models.predictors[layer - 1]} & steps
    # Tables that the layer may code with: those of `steps`, of no step, and of offsets.
    usable = sum(n for key, n in tables.items() if not key[1] or key[0] == Stream.OFFSETS or key in steps)
    total = TILE_LAYER + GROUP * usable * (passes if predicted else 1)
    total += PASS * passes * len(predicted)
    if row.neural and models.network is not None:
        total += max(row.stages) * passes * STAGE_PASS
    return total


def _steps(model: SceneModel, layer: int) -> set[tuple[int, int]]:
    """(stream, step) of the steps that some class receives in a layer."""
    rows, before = model.layers, model.layers[layer - 2] if layer > 1 else LayerRow((), ())
    steps = set()
    for index, channel in enumerate(model.channels):
        for kind, after in enumerate(rows[layer - 1].steps):
            first = before.steps[kind][index] if kind < before.class_count else 0
            steps |= {(int(channel.stream), step) for step in range(first + 1, after[index] + 1)}
    return steps


def _of_anchor(models: SceneModels, layer: int, kind: int) -> int:
    """Work for an anchor of class `kind` in one layer."""
    model = models.model
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
        for (stream, _, step), predictor in models.predictors[layer - 1].items()
        if received[predictor.stream][0] < step <= received[predictor.stream][1]
    )
    indices = _of_indices(models.network if row.neural else None, stages, row.stages[kind])
    # Whether or not anything is received, the anchor is looked at, channel by channel.
    return SYMBOL * (1 + len(model.channels)) + SYMBOL * (symbols + slots) + predicted + indices


def _of_indices(network: IndexNetwork | None, before: int, after: int) -> int:
    """Work for the stages of an anchor that a layer adds."""
    if before == after:
        return 0
    if network is None:
        return SYMBOL * (after - before)
    logits = max(len(head.biases) for head in network.heads)
    return network.multiply_adds(after) + (after - before) * (SYMBOL + NUMBER * logits)


def _of_result(models: SceneModels) -> int:
    """Work for the values of an anchor, once all its symbols are there."""
    networks = (*(() if models.decoder is None else (models.decoder,)), *models.scene_mlps)
    numbers = sum(channel.components for channel in models.model.channels)
    products, kept = 0, networks[0].outputs if networks else 0
    for network in networks:
        products += sum(layer.weights.size for layer in network.layers)
        numbers += max(layer.weights.shape[0] for layer in network.layers) + network.inputs
    return PRODUCT * products + NUMBER * numbers + OUTPUT * kept


class NumberBudget:
    """The adaptive numbers that the blocks of a file may have together (SPEC §13.2).

    Attributes:
        left: numbers that the next blocks may have.
    """

    def __init__(self, file_length: int, limits: Limits) -> None:
        self.left = FREE_NUMBERS + limits.numbers_per_byte * file_length

    def spend(self, count: int) -> bool:
        """Take `count` of them; whether there were as many."""
        self.left -= count
        return self.left >= 0


def check_work(work: int, file_length: int, limits: Limits) -> None:
    """Refuse a file that declares more work than its bytes pay for (SPEC §13.2).

    Raises:
        LimitExceeded: ``limit-work``.
    """
    most = FREE_WORK + limits.work_per_byte * file_length
    if work > most:
        message = f"decoding takes {work} multiply-adds, this reader's limit is {most}: raise it if you trust the file"
        raise LimitExceeded("limit-work", message, field="work")
