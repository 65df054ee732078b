"""From the integers of ranges to the bytes of a file: histograms, tables, TILE blocks, and the file (encoder only).

What :func:`scarfmt.coding.writer.write_scene` does with all tiles at hand, range by range: the file is the same. No
more is held than the directory and a piece of a range.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, BinaryIO

import numpy as np

from reference_encoder.out_of_core.fit import Fit
from reference_encoder.out_of_core.overview import Overview
from reference_encoder.out_of_core.types import Histograms, Models, RangeSymbols, Rows
from reference_encoder.out_of_core.work_dir import WorkDir, file_name
from reference_encoder.profiles.explicit import ENCODE_REPORT, report_encoding
from scarfmt.arrays import I64, U8
from scarfmt.coding.writer import Histogram, QuantisedScene, fit_tables, layer_counts, model_blocks, record_tile
from scarfmt.container.directory import Table, tile_table
from scarfmt.container.file import Block, HeaderFields, directory_row, encode_front, streams_of
from scarfmt.container.schema import ENTRY_DTYPE, STREAM_COUNT, BlockKind, Stream
from scarfmt.container.source import use_source
from scarfmt.entropy.emitters import SymbolCounter
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.symbol_tables import StaticTables, SymbolTable


def count_symbols(scene: QuantisedScene, losses: I64) -> tuple[Histograms, RangeSymbols]:
    """Count how often each symbol of a range comes under each table, layer after layer; and record the symbols.

    Args:
        scene, losses: of :func:`reference_encoder.out_of_core.fit.apply`.
    """
    found, recorded = [], []
    for layer in range(1, len(scene.model.layers) + 1):
        counter, neural = SymbolCounter(), scene.neural(layer)
        tiles = range(len(scene.tiles))
        recorded.append(tuple(record_tile(scene, layer, tile, neural, counter) for tile in tiles))
        found.append(counter.histograms())
    anchors = np.array([anchors for anchors, _ in layer_counts(scene)], np.int64)
    return Histograms(tuple(found), anchors, losses), (scene.tiles, tuple(recorded))


def add_layer_histograms(parts: Sequence[Histogram]) -> dict[TableKey, tuple[I64, I64]]:
    """Several histograms as one, keys ascending."""
    found: dict[TableKey, list[tuple[I64, I64]]] = {}
    for key, counted in itertools.chain.from_iterable(part.items() for part in parts):
        found.setdefault(key, []).append(counted)
    return {key: _sum_counts(counted) for key, counted in sorted(found.items())}


def _sum_counts(parts: Sequence[tuple[I64, I64]]) -> tuple[I64, I64]:
    if len(parts) == 1:
        return parts[0]
    alphabet, place = np.unique(np.concatenate([values for values, _ in parts]), return_inverse=True)
    counts = np.zeros(len(alphabet), np.int64)
    np.add.at(counts, place, np.concatenate([counts for _, counts in parts]))
    return alphabet, counts


def add_histograms(parts: Sequence[Histograms]) -> Histograms:
    """Histograms of several ranges as one: sums, so that they may be added up in any order."""
    return Histograms(
        tuple(add_layer_histograms(layer) for layer in zip(*(each.layers for each in parts), strict=True)),
        np.sum([each.anchors for each in parts], axis=0),
        np.sum([each.losses for each in parts], axis=0),
    )


def build_models(overview: Overview, fit: Fit, found: Histograms, metadata: Mapping[str, Any] | None = None) -> Models:
    """Static tables of all layers, and the model blocks of the file.

    Args:
        found: of all its ranges (:func:`add_histograms`).
        metadata: JSON-able annotations beside those of the options, such as ``quality``.
    """
    annotations = {ENCODE_REPORT: describe_encode(overview, found), **overview.options.metadata, **(metadata or {})}
    scene = replace(fit.scene((), ()), metadata=annotations)
    known = StaticTables()
    tables, blocks = list[Mapping[TableKey, SymbolTable]](), list[Block]()
    for layer, histogram in enumerate(found.layers, start=1):
        sent = fit_tables(histogram, known)
        known = StaticTables({**known, **sent})
        tables.append(known)
        blocks += model_blocks(scene, layer, sent)
    return Models(tuple(tables), tuple(blocks), found.anchors)


def add_blocks(models: Models, blocks: Sequence[Block]) -> Models:
    """The models with other blocks that belong to no tile, in file order."""
    return replace(models, blocks=tuple(sorted((*models.blocks, *blocks), key=lambda block: (block.layer, block.kind))))


def describe_encode(overview: Overview, found: Histograms) -> dict[str, Any]:
    """JSON-able member of METADATA: how the scene was looked at, and what of it is not in the file as it was."""
    *left_out, plain = (int(count) for count in found.losses)
    ranges = {"ranges": len(overview.edges) - 1, "judged_ranges": len(overview.judging)}
    report = report_encoding(overview.survey, (left_out[0], left_out[1]), plain if overview.bounds.sh_degree else None)
    return {**report, **ranges}


def code_layers(models: Models, symbols: RangeSymbols) -> Iterator[tuple[U8, I64, bytes]]:
    """The TILE blocks of a range under the tables of the file, of each layer: the bytes of their rows in the directory,
    tiles numbered within the range; (kinds,) int64 bytes of each kind of stream; and their bytes."""
    for layer, (tables, tiles) in enumerate(zip(models.tables, symbols[1], strict=True), start=1):
        coded = (each.block(layer, tile, tables) for tile, each in enumerate(tiles))
        blocks = [block for block in coded if block is not None]
        streams = np.array([streams_of(block) for block in blocks], np.int64).reshape(-1, STREAM_COUNT).sum(axis=0)
        rows = np.array([directory_row(block) for block in blocks], ENTRY_DTYPE)
        yield rows.view(np.uint8), streams, b"".join(block.payload for block in blocks)


PIECE_BYTES = 1 << 22
"""Bytes that are copied at once."""


def write_file(work: WorkDir, fields: HeaderFields, models: Models, ranges: Sequence[Rows], target: BinaryIO) -> int:
    """Write the file whose blocks are in a work directory.

    Args:
        work: with the segments of all ranges.
        models: their blocks, and how many anchors each layer has.
        ranges: what the directory says of the blocks of each range, in Morton order.

    Returns:
        Bytes written.

    Raises:
        InvalidInput: ``input-container``: the file would break a rule.
    """
    tiles = tile_table([tile for rows in ranges for tile in rows.tiles])
    before, after = _by_layer(models, below=True), _by_layer(models, below=False)
    directory = [part for layer in range(len(models.anchors)) for part in _directory_rows(layer, before, ranges, after)]
    counts = [(int(anchors), int(anchors)) for anchors in models.anchors]
    streams = np.sum([rows.stream_bytes for rows in ranges], axis=0)
    for layer in range(len(counts)):
        streams[layer, Stream.MODELS] += sum(len(block.payload) for block in (*before[layer], *after[layer]))
    written = target.write(encode_front(fields, tiles, np.concatenate(directory), counts, streams.tolist()))
    for layer in range(len(counts)):
        written += sum(target.write(block.payload) for block in before[layer])
        for number, rows in enumerate(ranges):
            written += sum(target.write(piece) for piece in _pieces(work, number, rows, layer))
        written += sum(target.write(block.payload) for block in after[layer])
    return written


def _by_layer(models: Models, below: bool) -> list[list[Block]]:
    """The blocks of each layer that come before those of its tiles, or after."""
    chosen = [block for block in models.blocks if (block.kind < BlockKind.TILE) == below]
    return [[block for block in chosen if block.layer == layer + 1] for layer in range(len(models.anchors))]


def _directory_rows(
    layer: int, before: list[list[Block]], ranges: Sequence[Rows], after: list[list[Block]]
) -> Iterator[Table]:
    """Rows of the directory of one layer."""
    yield np.array([directory_row(block) for block in before[layer]], ENTRY_DTYPE)
    first = 0
    for rows in ranges:
        table = rows.table(layer).copy()
        table["tile"] += first
        first += len(rows.tiles)
        yield table
    yield np.array([directory_row(block) for block in after[layer]], ENTRY_DTYPE)


def _pieces(work: WorkDir, number: int, rows: Rows, layer: int) -> Iterator[bytes]:
    """The bytes of a range in a layer."""
    sizes = [int(rows.table(each)["length"].sum()) for each in range(len(rows.layers))]
    begin, end = sum(sizes[:layer]), sum(sizes[: layer + 1])
    if begin == end:
        return
    with use_source(work.origin(file_name("segments", number))) as source:
        for offset in range(begin, end, PIECE_BYTES):
            yield source.read(offset, min(PIECE_BYTES, end - offset))
