"""Whole files from scenes."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace

from conformance.decoders.python.hash_grid import parse_grid
from conformance.decoders.python.index_network import parse_network
from conformance.decoders.python.predictors import parse_predictors
from conformance.writer.container import write_container
from conformance.writer.entropy import Table, Tables, table_records
from conformance.writer.models import codebooks_block, layer_block, networks_content
from conformance.writer.networks import grid_block, network_block, predictors_block
from conformance.writer.neural import Models
from conformance.writer.options import WriteOptions
from conformance.writer.streaming import streaming_block
from conformance.writer.tables import layer_tables
from conformance.writer.tile import TileLayer, tile_block, tile_layer
from scarfmt.arrays import Ints
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.file import Block
from scarfmt.container.schema import BlockKind, Profile, Stream

PLAIN = WriteOptions()
_SAFE_TO_COPY = 2


def write_file(scene: QuantisedScene, options: WriteOptions = PLAIN) -> bytes:
    """The bytes of a file. Nothing is checked: a scene that breaks a rule gives a file that does.

    Raises:
        MissingTable: when the tables of the options do not code a symbol.
    """
    known: Tables = {}
    models = Models()
    blocks = list(options.blocks)
    for layer in range(1, len(scene.model.layers) + 1):
        own = list(_model_blocks(scene, layer, options))
        models = _in_force(models, scene, layer, own)
        tiles = [tile_layer(scene, layer, number, models) for number in range(len(scene.tiles))]
        sent = layer_tables((part for tile in tiles for part in tile.streams.values()), known, layer, options)
        known = {**known, **sent}
        blocks += [*own, *_tables_block(sent, layer, options), *_tile_blocks(tiles, known, layer, options)]
    return write_container(scene.fields, scene.tiles, blocks, layer_counts(scene), page_bits=options.page_bits)


def layer_counts(scene: QuantisedScene) -> list[tuple[int, int]]:
    """Per layer, cumulative anchors and Gaussians (SPEC §5.3)."""
    out = []
    for layer, row in enumerate(scene.model.layers, start=1):
        anchors = sum(int((content.classes < len(row.stages)).sum()) for content in scene.contents)
        slots = sum(int(((c.slot_layers > 0) & (c.slot_layers <= layer)).sum()) for c in scene.contents)
        out.append((anchors, slots if scene.fields.profile == Profile.ANCHOR else anchors))
    return out


def _tables_block(tables: dict[int, Table], layer: int, options: WriteOptions) -> list[Block]:
    if not tables:
        return []
    payload = options.frame(BlockKind.TABLES, table_records(tables))
    return [Block(BlockKind.TABLES, layer, payload, count=len(tables))]


def _tile_blocks(tiles: list[TileLayer], tables: Tables, layer: int, options: WriteOptions) -> Iterator[Block]:
    for number, tile in enumerate(tiles):
        streams = {kind: stream.code(tables) for kind, stream in tile.streams.items()}
        if tile.new or any(streams.values()) or options.empty_tiles:
            sizes = {kind: len(data) for kind, data in streams.items() if data}
            yield Block(BlockKind.TILE, layer, tile_block(streams), number, tile.new, sizes)


def _model_blocks(scene: QuantisedScene, layer: int, options: WriteOptions) -> Iterator[Block]:
    """The blocks of no tile but TABLES, in the order of their kinds."""
    row = scene.model.layers[layer - 1]
    opening = (scene.model.channels, scene.model.context) if layer == 1 else None
    yield Block(BlockKind.LAYER, layer, layer_block(row, opening), count=len(row.stages))
    books = _books(scene, layer)
    if books:
        yield Block(BlockKind.CODEBOOKS, layer, codebooks_block(books, options.rice), count=len(books))
    if scene.decoder is not None and _first(scene, 0, latent=True) == layer:
        content = networks_content((scene.decoder,), wide=options.wide_weights)
        yield Block(BlockKind.DECODER_MLP, layer, options.frame(BlockKind.DECODER_MLP, content), count=1)
    if scene.scene_mlps and layer == 1:
        content = networks_content(scene.scene_mlps, wide=options.wide_weights)
        payload = options.frame(BlockKind.SCENE_MLP, content)
        yield Block(BlockKind.SCENE_MLP, 1, payload, count=len(scene.scene_mlps))
    yield from _neural_blocks(scene, layer, options)
    if layer == 1 and (scene.metadata or options.metadata is not None):
        text = json.dumps(scene.metadata, sort_keys=True, separators=(",", ":"), allow_nan=False)
        yield Block(BlockKind.METADATA, 1, text.encode() if options.metadata is None else options.metadata)
    if layer == 1 and scene.streaming is not None:
        boxes = scene.streaming
        yield Block(BlockKind.STREAMING, 1, streaming_block(boxes), count=len(boxes.reach), flags=_SAFE_TO_COPY)


def _neural_blocks(scene: QuantisedScene, layer: int, options: WriteOptions) -> Iterator[Block]:
    neural = [number for number, row in enumerate(scene.model.layers, start=1) if row.neural]
    if scene.network is not None and neural[:1] == [layer]:
        if scene.grid is not None:
            payload = grid_block(scene.grid, options.grid_ones)
            yield Block(BlockKind.HASH_GRID, layer, payload, count=len(scene.grid.levels))
        yield Block(BlockKind.ENTROPY_NETWORK, layer, network_block(scene.network, options.rice), count=1)
    group = scene.predictors.get(layer, ())
    if group:
        payload = predictors_block(group, options.class_columns, options.rice)
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


def _in_force(models: Models, scene: QuantisedScene, layer: int, blocks: list[Block]) -> Models:
    """The neural models after the blocks of a layer, as a decoder reads them."""
    payloads = {block.kind: block.payload for block in blocks}
    books = {**models.books, **{number: book.tolist() for number, book in _books(scene, layer).items()}}
    models = replace(models, books=books)
    if BlockKind.PREDICTORS in payloads:
        added = parse_predictors(payloads[BlockKind.PREDICTORS])
        models = replace(models, predictors={**models.predictors, **added})
    if BlockKind.HASH_GRID in payloads:
        models = replace(models, grid=parse_grid(payloads[BlockKind.HASH_GRID]))
    if BlockKind.ENTROPY_NETWORK in payloads:
        models = replace(models, network=parse_network(payloads[BlockKind.ENTROPY_NETWORK]))
    return models
