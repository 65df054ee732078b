"""Files of parts of one scene as one file, without decoding them.

They must have equal models, layers and lattice, as `split` and an encoder of ranges leave them; their tiles must not
overlap. The result is byte for byte what the writer makes of all their tiles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import BinaryIO

import numpy as np

from scarfmt.arrays import I64, U64
from scarfmt.blocks.streaming import Streaming, read_streaming, streaming_block
from scarfmt.container.directory import Table
from scarfmt.container.file import Block, Container, HeaderFields, directory_row
from scarfmt.container.schema import ENTRY_DTYPE, BlockKind, Stream
from scarfmt.container.source import ByteSource
from scarfmt.errors import InvalidInput
from scarfmt.limits import MAX_TILE_DEPTH
from scarfmt.tools.assemble import Plan, entry_of, order_rows, pieces

_BOXES = ("low", "high", "reach")
_SUMMARY = ["kind", "flags", "layer", "length", "count", "crc32"]


def merge_to(sources: Sequence[ByteSource], target: BinaryIO) -> int:
    """Write the file of all tiles of some files, in pieces of at most 1 MiB.

    Blocks are verified while they are copied, so `target` holds an unfinished file when an error is raised. What
    annotations say is kept where all files say the same; STREAMING boxes of tiles are joined where all files have them.

    Args:
        sources: the files, in any order; one at least.
        target: opened for writing in binary mode.

    Returns:
        Bytes written.

    Raises:
        InvalidInput: ``input-fields-differ``, ``input-models-differ``, ``input-overlap``.
        Malformed, Truncated, Unsupported, LimitExceeded: what :class:`~scarfmt.container.file.Container` refuses.
    """
    files = [Container(source) for source in sources]
    return plan_merge(files).write(files, target)


def plan_merge(files: Sequence[Container]) -> Plan:
    """The file of all tiles of some files. Arguments and errors as :func:`merge_to`."""
    fields = _fields(files)
    for number in range(1, len(files)):
        _check_models(files, number)
    tiles = np.concatenate([file.tile_table for file in files])
    order = _order(tiles)
    places = np.empty(len(tiles), np.int64)
    places[order] = np.arange(len(tiles))
    starts = np.cumsum([0, *(len(file.tile_table) for file in files)])
    rows = [_outside_tiles(files)]
    origins = [np.zeros(len(rows[0]), np.int64)]
    for number, file in enumerate(files):
        own = file.directory[file.directory["kind"] == BlockKind.TILE].copy()
        own["tile"] = places[starts[number] + own["tile"].astype(np.int64)]
        rows.append(own)
        origins.append(np.full(len(own), number))
    made = _streaming(files, order)
    if made is not None:
        rows.append(np.array([directory_row(made)], ENTRY_DTYPE))
        origins.append(np.array([-1]))
    table, origin = order_rows(np.concatenate(rows), np.concatenate(origins))
    return Plan(fields, tiles[order], table, origin, [] if made is None else [made.payload], *_sums(files, table))


def _fields(files: Sequence[Container]) -> HeaderFields:
    """Header fields of the whole, whose source had what the sources of all files had together."""
    count = sum(file.header.fields.source_count for file in files)
    for number, file in enumerate(files):
        if replace(file.header.fields, source_count=0) != replace(files[0].header.fields, source_count=0):
            message = f"file {number + 1} has another lattice, profile, frame or colour space than the first"
            raise InvalidInput("input-fields-differ", message)
    return replace(files[0].header.fields, source_count=count)


def _models(file: Container) -> Table:
    """Rows of the model blocks."""
    return file.directory[file.directory["kind"] <= BlockKind.PREDICTORS]


def _check_models(files: Sequence[Container], number: int) -> None:
    """Check that a file has the models of the first, byte for byte, in as many layers."""
    first, file = files[0], files[number]
    ours, theirs = _models(first), _models(file)
    same = file.header.layer_count == first.header.layer_count and np.array_equal(ours[_SUMMARY], theirs[_SUMMARY])
    for one, other in zip(ours, theirs, strict=True) if same else ():
        same = same and b"".join(pieces(first, entry_of(one))) == b"".join(pieces(file, entry_of(other)))
    if not same:
        message = f"file {number + 1} has other models or layers than the first: files are merged that were encoded"
        raise InvalidInput("input-models-differ", f"{message} together, or split from one")


def first_codes(tiles: Table) -> tuple[U64, U64]:
    """Morton code at `MAX_TILE_DEPTH` at which each tile begins, and one past its last."""
    free = (3 * (MAX_TILE_DEPTH - tiles["depth"].astype(np.int64))).astype(np.uint64)
    return tiles["prefix"] << free, (tiles["prefix"] + np.uint64(1)) << free


def _order(tiles: Table) -> I64:
    """The tiles of all files in Morton order."""
    first, past = first_codes(tiles)
    order = np.argsort(first, kind="stable")
    if (past[order][:-1] > first[order][1:]).any():
        raise InvalidInput("input-overlap", "tiles of two files overlap: they show parts of the scene twice")
    return order


def _outside_tiles(files: Sequence[Container]) -> Table:
    """Rows of the first file of what belongs to no tile: models, and annotations that all files have alike."""
    rows = files[0].directory
    kept = rows["kind"] <= BlockKind.PREDICTORS
    for row in np.flatnonzero(~kept & ~np.isin(rows["kind"], [BlockKind.TILE, BlockKind.STREAMING])).tolist():
        entry = entry_of(rows[row])
        others = [file.find(entry.kind, entry.layer) for file in files[1:]]
        told = [] if None in others else [(one.length, one.crc32, one.flags) for one in others if one is not None]
        kept[row] = len(told) == len(others) and set(told) <= {(entry.length, entry.crc32, entry.flags)}
    return rows[kept]


def _streaming(files: Sequence[Container], order: I64) -> Block | None:
    """The STREAMING values of all tiles, with the view if all files have the same; None if a file has no such block."""
    parts = [found for file in files if (found := read_streaming(file)) is not None]
    if len(parts) < len(files):
        return None
    low, high, reach = (np.concatenate([getattr(part, name) for part in parts])[order] for name in _BOXES)
    same_view = len({str(part.view) for part in parts}) == 1
    return streaming_block(Streaming(low, high, reach, parts[0].view if same_view else None))


def model_bytes(rows: Table, layers: int) -> list[int]:
    """Bytes of what belongs to no tile, by layer."""
    outside = rows[rows["kind"] != BlockKind.TILE]
    return [int(outside["length"][outside["layer"] == layer + 1].sum(dtype=np.uint64)) for layer in range(layers)]


def _sums(files: Sequence[Container], rows: Table) -> tuple[list[tuple[int, int]], list[list[int]]]:
    """Per layer, cumulative (anchors, Gaussians), and bytes of each kind of stream."""
    counts, streams = [], []
    for layer, models in enumerate(model_bytes(rows, files[0].header.layer_count)):
        summaries = [file.header.layers[layer] for file in files]
        counts.append((sum(one.anchor_count for one in summaries), sum(one.gaussian_count for one in summaries)))
        sizes = [sum(found) for found in zip(*(one.stream_bytes for one in summaries), strict=True)]
        sizes[Stream.MODELS] = models
        streams.append(sizes)
    return counts, streams
