"""From the integers of ranges to the bytes of a file: histograms, tables, TILE blocks (encoder only).

What :func:`scarfmt.coding.writer.write_scene` does with all tiles at hand, range by range: the file is the same.
"""

from __future__ import annotations

import itertools
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from reference_encoder.profiles.account import ACCOUNT
from reference_encoder.scale.fit import Fit
from reference_encoder.scale.glance import Overview
from reference_encoder.scale.steps import Histograms, LayerSegment, Models, RangeContent, RangeSymbols, Segment
from scarfmt.arrays import I64
from scarfmt.coding.writer import Histogram, fitted_tables, layer_counts, model_blocks, record_tile
from scarfmt.container.file import Block, streams_of
from scarfmt.container.schema import STREAM_COUNT
from scarfmt.engines import best_engine
from scarfmt.entropy.emitters import SymbolCounter
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.symbol_tables import StaticTables, SymbolTable


def histograms(fit: Fit, content: RangeContent) -> tuple[Histograms, RangeSymbols]:
    """Count how often each symbol of a range comes under each table, layer after layer; and record the symbols."""
    scene, engine = fit.scene(content), best_engine()
    found, kept = [], []
    for layer in range(1, len(fit.model.layers) + 1):
        counter, neural = SymbolCounter(), scene.neural(layer)
        tiles = range(len(content.tiles))
        kept.append(tuple(record_tile(scene, layer, tile, neural, counter, engine) for tile in tiles))
        found.append(counter.histograms())
    anchors = np.array([anchors for anchors, _ in layer_counts(scene)], np.int64)
    counted = Histograms(tuple(found), anchors, content.left_out, content.without_view_dependence)
    return counted, RangeSymbols(content.tiles, tuple(kept))


def added(parts: Sequence[Histogram]) -> dict[TableKey, tuple[I64, I64]]:
    """Several histograms as one, keys ascending."""
    found: dict[TableKey, list[tuple[I64, I64]]] = {}
    for key, counted in itertools.chain.from_iterable(part.items() for part in parts):
        found.setdefault(key, []).append(counted)
    return {key: _summed(counted) for key, counted in sorted(found.items())}


def _summed(parts: Sequence[tuple[I64, I64]]) -> tuple[I64, I64]:
    if len(parts) == 1:
        return parts[0]
    alphabet, place = np.unique(np.concatenate([values for values, _ in parts]), return_inverse=True)
    counts = np.zeros(len(alphabet), np.int64)
    np.add.at(counts, place, np.concatenate([counts for _, counts in parts]))
    return alphabet, counts


def together(parts: Sequence[Histograms]) -> Histograms:
    """Histograms of several ranges as one: sums, so that they may be added up in any order."""
    invisible, faint = (sum(each.left_out[k] for each in parts) for k in (0, 1))
    return Histograms(
        tuple(added(layer) for layer in zip(*(each.layers for each in parts), strict=True)),
        np.sum([each.anchors for each in parts], axis=0),
        (invisible, faint),
        sum(each.without_view_dependence for each in parts),
    )


def reduce(
    overview: Overview, fit: Fit, parts: Sequence[Histograms], metadata: Mapping[str, Any] | None = None
) -> Models:
    """Static tables of all layers, and the model blocks of the file.

    Args:
        overview, fit: of the scene.
        parts: of all its ranges, or of groups of them (:func:`together`).
        metadata: JSON-able annotations beside those of the options, such as ``quality``.
    """
    found = together(parts)
    told = {ACCOUNT: account(overview, found), **overview.options.metadata, **(metadata or {})}
    scene = replace(fit.scene(RangeContent((), ())), metadata=told)
    known = StaticTables({})
    tables, blocks = list[Mapping[TableKey, SymbolTable]](), list[Block]()
    for layer, histogram in enumerate(found.layers, start=1):
        sent = fitted_tables(histogram, known)
        known = StaticTables({**known, **sent})
        tables.append(known)
        blocks += model_blocks(scene, layer, sent)
    return Models(tuple(tables), tuple(blocks), found.anchors)


def account(overview: Overview, found: Histograms) -> dict[str, Any]:
    """JSON-able member of METADATA: how the scene was looked at, and what of it is not in the file as it was."""
    looked, (invisible, faint) = overview.survey, found.left_out
    told: dict[str, Any] = {
        "up": looked.up.up,
        "up_detected": not looked.up.given,
        "radius": float(f"{looked.radius:.3g}"),
        "views": {kind: len(cameras) for kind, cameras in looked.views.items()},
        "left_out": {"invisible": invisible, "faint": faint},
        "ranges": len(overview.edges) - 1,
        "judged_ranges": len(overview.judging),
    }
    if looked.up.other is not None:
        told["up_or"] = looked.up.other
    if overview.bounds.sh_degree:
        told["without_view_dependence"] = found.without_view_dependence
    return told


def code(models: Models, symbols: RangeSymbols) -> Segment:
    """The TILE blocks of a range under the tables of the file."""
    engine, layers = best_engine(), []
    for layer, (tables, tiles) in enumerate(zip(models.tables, symbols.layers, strict=True), start=1):
        made = (each.block(layer, tile, tables, engine) for tile, each in enumerate(tiles))
        layers.append(_segment([block for block in made if block is not None]))
    return Segment(symbols.tiles, layers)


def _segment(blocks: Sequence[Block]) -> LayerSegment:
    streams = np.array([streams_of(block) for block in blocks], np.int64).reshape(-1, STREAM_COUNT).sum(axis=0)
    return LayerSegment(
        b"".join(block.payload for block in blocks),
        np.array([block.tile for block in blocks], np.int64),
        np.array([len(block.payload) for block in blocks], np.int64),
        np.array([block.count for block in blocks], np.int64),
        np.array([zlib.crc32(block.payload) for block in blocks], np.uint32),
        tuple(streams.tolist()),
    )
