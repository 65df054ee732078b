"""Whole files from scenes.

Symbols are recorded and coded by the package's writer; tables, models, ROOT and pages are chosen and packed
here. That a file says what its scene holds is the readable decoder's to find (:mod:`conformance.expect.document`).
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence

from conformance.writer.container import write_container
from conformance.writer.models import codebooks_block, layer_block, network_numbers
from conformance.writer.networks import grid_block, network_block, predictors_block
from conformance.writer.numbers import numbers_block
from conformance.writer.options import Tables, WriteOptions
from conformance.writer.streaming import streaming_block
from conformance.writer.tables import Record, layer_tables, table_numbers
from scarfmt.arrays import Ints
from scarfmt.blocks.mlp import QuantisedMlp
from scarfmt.coding.writer import QuantisedScene, layer_counts, record_tile
from scarfmt.container.file import Block
from scarfmt.container.schema import BlockKind, Stream
from scarfmt.container.substreams import pack_substreams
from scarfmt.entropy.emitters import SymbolCounter
from scarfmt.entropy.symbol_tables import StaticTables

PLAIN = WriteOptions()
_SAFE_TO_COPY = 2


def write_file(scene: QuantisedScene, options: WriteOptions = PLAIN) -> bytes:
    """The bytes of a file. Nothing is checked: a scene that breaks a rule may give a file that does.

    Raises:
        InvalidInput: ``input-symbol`` when the tables of the options do not code a symbol.
    """
    known: Tables = {}
    blocks = list(options.blocks)
    for layer in range(1, len(scene.model.layers) + 1):
        counter, neural = SymbolCounter(), scene.neural(layer)
        tiles = [record_tile(scene, layer, number, neural, counter) for number in range(len(scene.tiles))]
        counted = counter.histograms()
        sent = layer_tables(counted, known, layer, options)
        known = {**known, **sent}
        used = StaticTables({key: known[key] for key in counted if key in known})
        blocks += _model_blocks(scene, layer, options)
        if sent:
            payload = numbers_block(table_numbers(_records(sent)))
            blocks.append(Block(BlockKind.TABLES, layer, payload, count=len(sent)))
        for number, tile in enumerate(tiles):
            block = tile.block(layer, number, used)
            if block is not None or options.empty_tiles:
                blocks.append(block or Block(BlockKind.TILE, layer, pack_substreams({}), number))
    return write_container(scene.fields, scene.tiles, blocks, layer_counts(scene), page_bits=options.page_bits)


def _model_blocks(scene: QuantisedScene, layer: int, options: WriteOptions) -> Iterator[Block]:
    """The blocks of no tile but TABLES, in the order of their kinds."""
    row = scene.model.layers[layer - 1]
    opening = (scene.model.channels, scene.model.context) if layer == 1 else None
    yield Block(BlockKind.LAYER, layer, layer_block(row, opening), count=len(row.stages))
    books = _books(scene, layer)
    if books:
        yield Block(BlockKind.CODEBOOKS, layer, codebooks_block(books), count=len(books))
    if scene.decoder is not None and _first(scene, 0, latent=True) == layer:
        yield Block(BlockKind.DECODER_MLP, layer, _networks((scene.decoder,)), count=1)
    if scene.scene_mlps and layer == 1:
        yield Block(BlockKind.SCENE_MLP, 1, _networks(scene.scene_mlps), count=len(scene.scene_mlps))
    yield from _neural_blocks(scene, layer, options)
    if layer == 1 and (scene.metadata or options.metadata is not None):
        text = json.dumps(scene.metadata, sort_keys=True, separators=(",", ":"), allow_nan=False)
        yield Block(BlockKind.METADATA, 1, text.encode() if options.metadata is None else options.metadata)
    if layer == 1 and scene.streaming is not None:
        boxes = scene.streaming
        yield Block(BlockKind.STREAMING, 1, streaming_block(boxes), count=len(boxes.reach), flags=_SAFE_TO_COPY)


def _records(tables: Tables) -> list[Record]:
    """The records of tables, by ascending key."""
    return [
        Record(key.number, table.alphabet.tolist(), table.weights.tolist()) for key, table in sorted(tables.items())
    ]


def _networks(networks: Sequence[QuantisedMlp]) -> bytes:
    return numbers_block(network_numbers([network.layers for network in networks]))


def _neural_blocks(scene: QuantisedScene, layer: int, options: WriteOptions) -> Iterator[Block]:
    neural = [number for number, row in enumerate(scene.model.layers, start=1) if row.neural]
    if scene.network is not None and neural[:1] == [layer]:
        if scene.grid is not None:
            payload = grid_block(scene.grid, options.grid_ones)
            yield Block(BlockKind.HASH_GRID, layer, payload, count=len(scene.grid.levels))
        yield Block(BlockKind.ENTROPY_NETWORK, layer, network_block(scene.network), count=1)
    group = scene.predictors.get(layer, ())
    if group:
        payload = predictors_block(group, options.class_columns)
        yield Block(BlockKind.PREDICTORS, layer, payload, count=len(group))


def _first(scene: QuantisedScene, stages: int, *, latent: bool = False) -> int | None:
    """The first layer in which a class has more than so many stages, or, with `latent`, a step of LATENT."""
    channels = [i for i, channel in enumerate(scene.model.channels) if latent and channel.stream == Stream.LATENT]
    for layer, row in enumerate(scene.model.layers, start=1):
        if max(row.stages) > stages or any(steps[i] for steps in row.steps for i in channels):
            return layer
    return None


def _books(scene: QuantisedScene, layer: int) -> dict[int, Ints]:
    """The codebooks first needed in a layer."""
    if scene.codebooks is None:
        return {}
    books = (scene.codebooks.coarse, scene.codebooks.residual)
    return {number: book for number, book in enumerate(books) if _first(scene, number) == layer}
