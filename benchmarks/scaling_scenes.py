"""Quantised scenes out of files, made into others to measure with: without networks, in smaller tiles, many times over.

The integers stay those that an encoder chose; :func:`scarfmt.coding.writer.write_scene` codes them anew.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from reference_encoder.decide.lattice import split
from scarfmt.arrays import I64, U64
from scarfmt.coding.models import SceneModels
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.tile import TileContent
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.directory import local_bits
from scarfmt.container.file import Tile
from scarfmt.container.source import open_source
from scarfmt.engines import best_engine
from scarfmt.limits import MAX_TILE_DEPTH
from scarfmt.neural.predictors import Predictor
from scarfmt.scene.model import DecodedContext, SceneModel

_REACH = 8
"""Jitter moves attributes to an anchor of the same class about so many places away in Morton order."""


def read_scene(path: str | Path) -> QuantisedScene:
    """Everything a file holds but its metadata: written again, it decodes to the same."""
    with open_source(path) as source:
        reader = SceneReader(source, engine=best_engine())
        models = reader.models()
        contents = tuple(content for _, content in reader.tiles(models))
    return QuantisedScene(
        reader.header.fields,
        models.model,
        reader.container.tiles,
        contents,
        models.codebooks,
        models.decoder,
        models.scene_mlps,
        predictors=_first_travels(models),
        network=models.network,
        grid=models.grid,
    )


def _first_travels(models: SceneModels) -> dict[int, tuple[Predictor, ...]]:
    """Per layer, the predictors that were not in force before it."""
    found: dict[int, tuple[Predictor, ...]] = {}
    before: set[tuple[int, int, int]] = set()
    for layer, here in enumerate(models.predictors, start=1):
        new = tuple(here[key] for key in sorted(here.keys() - before))
        if new:
            found[layer] = new
        before |= here.keys()
    return found


def without_networks(scene: QuantisedScene) -> QuantisedScene:
    """A scene with its integers under static tables alone."""
    layers = tuple(replace(row, neural=False) for row in scene.model.layers)
    model = replace(scene.model, context=DecodedContext(), layers=layers)
    return replace(scene, model=model, predictors={}, network=None, grid=None)


def recut(scene: QuantisedScene, most: int) -> QuantisedScene:
    """A scene with its anchors in tiles of at most `most`: every tile that has more is cut, its lattice stays."""
    tiles: list[Tile] = []
    contents: list[TileContent] = []
    for tile, content in zip(scene.tiles, scene.contents, strict=True):
        bits = local_bits(scene.fields, tile)
        for part, rows in _cubes(content.codes, bits, min(bits, MAX_TILE_DEPTH - tile.depth), most):
            low = np.uint64((1 << 3 * (bits - part.depth)) - 1)
            tiles.append(Tile(tile.depth + part.depth, tile.shift, tile.prefix << 3 * part.depth | part.prefix))
            contents.append(taken(content, rows, content.codes[rows] & low))
    return replace(scene, tiles=tuple(tiles), contents=tuple(contents))


def _cubes(codes: U64, bits: int, deepest: int, most: int) -> Iterator[tuple[Tile, I64]]:
    """Cubes of a tile, as tiles of its own lattice, and the rows in each, in the order of the tile."""
    if not len(codes):
        yield Tile(0, 0, 0), np.zeros(0, np.int64)
        return
    order = np.argsort(codes, kind="stable")
    depths, prefixes, firsts = split(codes[order] >> np.uint64(3 * (bits - deepest)), deepest, most)
    parts = np.split(order, firsts[1:])
    for depth, prefix, rows in zip(depths.tolist(), prefixes.tolist(), parts, strict=True):
        yield Tile(depth, 0, prefix), np.sort(rows)


def taken(content: TileContent, rows: I64, codes: U64) -> TileContent:
    """Some anchors of a tile, at `codes`."""
    return TileContent(
        codes,
        content.classes[rows],
        [values[rows] for values in content.values],
        [values[rows] for values in content.first],
        content.indices[rows],
        content.slot_layers[rows],
    )


def copies(scene: QuantisedScene, count: int, seed: int = 0) -> QuantisedScene:
    """A scene `count` times, side by side on a larger lattice; all but the first copy are jittered.

    Jitter flips the last bits of half of the positions and trades attributes between neighbours of a class: every copy
    has symbols of its own, with the frequencies of the first.
    """
    grid = int(np.ceil(np.log2(count) / 3)) if count > 1 else 0
    random = np.random.default_rng(seed)
    tiles: list[Tile] = []
    contents: list[TileContent] = []
    for number in range(count):
        for tile, content in zip(scene.tiles, scene.contents, strict=True):
            tiles.append(Tile(tile.depth + grid, tile.shift, number << 3 * tile.depth | tile.prefix))
            bits = local_bits(scene.fields, tile)
            contents.append(jittered(scene.model, content, bits, random) if number else content)
    fields = replace(
        scene.fields, lattice_bits=scene.fields.lattice_bits + grid, source_count=scene.fields.source_count * count
    )
    return replace(scene, fields=fields, tiles=tuple(tiles), contents=tuple(contents))


def jittered(model: SceneModel, content: TileContent, bits: int, random: np.random.Generator) -> TileContent:
    """A tile with other positions and other neighbours, class by class as many anchors as before."""
    rows = np.arange(len(content))
    places = rows + _REACH * random.random(len(rows))
    by_class = np.argsort(content.classes, kind="stable")
    # Both orders list class after class: the anchor at a place gets what another of its class had.
    rows[by_class] = np.lexsort((places, content.classes))
    flips = random.integers(0, 8, len(rows), np.uint64) * random.integers(0, 2, len(rows), np.uint64)
    codes = content.codes ^ flips if bits else content.codes
    appears = np.searchsorted([row.class_count for row in model.layers], content.classes, side="right")
    order = np.lexsort((codes, appears))
    return taken(content, rows[order], codes[order])


def summary(scene: QuantisedScene) -> dict[str, Any]:
    """Gaussians put in, anchors held, tiles."""
    anchors = sum(len(content) for content in scene.contents)
    return {"source_count": scene.fields.source_count, "anchors": anchors, "tiles": len(scene.tiles)}
