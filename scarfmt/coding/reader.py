"""From the bytes of a file to exact tile contents (SPEC §5-§8): what a decoder does before any float.

:class:`SceneReader` reads only the blocks, and within a block only the sub-streams, that the layers, tiles
and attributes asked for need.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from functools import partial
from typing import TypeVar

import numpy as np

from scarfmt.arrays import I64
from scarfmt.blocks.registry import MODEL_BLOCKS
from scarfmt.coding.models import ModelBlocks, SceneModels, load_models, run_at
from scarfmt.coding.tile import NeuralModels, TileContent, find_needed, get_layer, list_coded
from scarfmt.coding.work import MOST_SPLITS, NumberBudget, check_work, compute_work
from scarfmt.container.directory import tile_frame
from scarfmt.container.file import COALESCE_BYTES, Container, Entry, check_crc
from scarfmt.container.schema import Stream
from scarfmt.container.source import ByteSource
from scarfmt.container.substreams import MAX_TABLE_SIZE, Substream, check_substream, unpack_table
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.symbol_reader import SymbolReader
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.errors import InvalidInput, Malformed, Truncated, plural
from scarfmt.limits import DEFAULT_LIMITS, Limits
from scarfmt.observe import LayerObserver, Observe, ObservedReader
from scarfmt.scene.model import Lattice, SceneModel

T = TypeVar("T")

ALL_STREAMS = frozenset(Stream) - {Stream.MODELS, Stream.FRAMING}
PREFETCH_BYTES = COALESCE_BYTES
"""Tiles are read ahead, all their layers, up to this size: few requests, and bounded memory."""

_ALWAYS = frozenset({Stream.POSITIONS, Stream.CLASSES, Stream.MASKS})
TileBlocks = Sequence[tuple[Entry | None, bytes | None]]
"""Per layer, a tile's block, if it has one, and its bytes, if they were read ahead."""


class SceneReader:
    """Reads models and tiles of one file, as SPEC defines them.

    Args:
        allow_truncated: use the whole layers of a cut file instead of refusing it.
    """

    def __init__(self, source: ByteSource, *, limits: Limits = DEFAULT_LIMITS, allow_truncated: bool = False) -> None:
        self._prepared: tuple[tuple[SceneModels, bool], tuple[NeuralModels, ...]] | None = None
        self.container = Container(source, limits=limits, allow_truncated=allow_truncated)
        self.header = self.container.header
        self.lattice = Lattice(self.header.fields.origin, self.header.fields.voxel, self.header.fields.lattice_bits)
        # What lies behind it is read as it is needed; that it is there shows here.
        _ = self.container.root

    def layer_number(self, layers: int | None) -> int:
        """`layers` checked against the file; None means all.

        Raises:
            InvalidInput: ``input-layers``.
            Truncated: ``truncated-block`` when a cut file holds no whole layer.
        """
        available = self.container.available_layers
        if available == 0:
            raise Truncated("truncated-block", "the file was cut inside its first layer: nothing can be decoded")
        if layers is None:
            return available
        if not 1 <= layers <= available:
            raise InvalidInput("input-layers", f"the file has {plural(available, 'layer')}, not {layers}")
        return layers

    def model_payloads(self, layers: int) -> dict[Entry, bytes]:
        """The model blocks of the first `layers` layers; those of one layer, being neighbours, in one request."""
        kinds = {spec.kind for spec in MODEL_BLOCKS}
        of_these = (entry for entry in self.container.models if entry.layer <= layers and entry.kind in kinds)
        return dict(self.container.read_blocks(of_these))

    def models(self, layers: int | None = None) -> SceneModels:
        """All model blocks of the first `layers` layers (None: all), to decode any tiles with.

        What the directory says of the tiles in those layers is read before, in few requests.

        Raises:
            Malformed: the directory is refused; a block is missing or breaks its rules.
            LimitExceeded: ``limit-work``, ``limit-expansion`` beside the limits of the directory and of blocks.
            InvalidInput: ``input-layers``.
        """
        count = self.layer_number(layers)
        self.container.load(count)
        return self.models_of(count, self.model_payloads(count), range(self.header.tile_count))

    def models_of(self, layers: int, payloads: dict[Entry, bytes], tiles: Sequence[int]) -> SceneModels:
        """The models in the `payloads` of the first `layers` layers, to decode some tiles with; refuses as
        :meth:`models`."""
        budget = NumberBudget(self.header.file_length, self.container.limits)
        models = load_models(self.header.fields, layers, ModelBlocks(payloads, budget.spend))
        declared = compute_work(models, *self.extent(layers, np.array(tiles, np.int64)))
        check_work(declared, self.header.file_length, self.container.limits)
        return models

    def extent(self, layers: int, tiles: I64) -> tuple[I64, int, int]:
        """The tiles, anchors and splits that the directory declares for some tiles in the first layers, as
        :func:`~scarfmt.coding.work.compute_work` takes them. Reads their pages."""
        counts, rows = self.container.tile_counts(layers, tiles), self.container.tile_rows(tiles)
        local = self.header.fields.lattice_bits - rows["depth"].astype(np.int64) - rows["shift"]
        splits = int((3 * local[:, None] * np.clip(counts - 1, 0, MOST_SPLITS)).sum())
        return (counts.cumsum(axis=1) > 0).sum(axis=0), int(counts.sum()), splits

    def tiles(
        self,
        models: SceneModels,
        tiles: Sequence[int] | None = None,
        streams: Collection[Stream] = ALL_STREAMS,
        observe: Observe | None = None,
    ) -> Iterator[tuple[int, TileContent]]:
        """(tile index, content after the models' last layer) of each tile asked for, in that order.

        Args:
            models: from :meth:`models`; fixes the layer.
            tiles: tile indices, None for all. Tiles without anchors are yielded empty.
            streams: attribute streams wanted; others are not read and their values stay 0.
            observe: gives the observers of what is computed on the way.

        Raises:
            InvalidInput: ``input-tiles`` for an index the file does not have; at once, before anything is read.
        """
        chosen, wanted = self.check_tiles(tiles), frozenset(streams)
        supply = zip(chosen, self.supply(len(models.tables), chosen, wanted), strict=True)
        return ((tile, self.tile(models, tile, blocks, wanted, observe)) for tile, blocks in supply)

    def check_tiles(self, tiles: Sequence[int] | None) -> list[int]:
        """`tiles` checked against the file; None means all.

        Raises:
            InvalidInput: ``input-tiles``.
        """
        count = self.header.tile_count
        chosen = list(range(count) if tiles is None else tiles)
        if any(not 0 <= tile < count for tile in chosen):
            raise InvalidInput("input-tiles", f"tile indices must be below {count}", field="tiles")
        return chosen

    def _neural(self, models: SceneModels, indices: bool) -> tuple[NeuralModels, ...]:
        """The models' networks, prepared once for all tiles."""
        if self._prepared is None or self._prepared[0][0] is not models or self._prepared[0][1] < indices:
            self._prepared = (models, indices), models.neural(indices=indices)
        return self._prepared[1]

    def supply(self, layers: int, tiles: list[int], streams: frozenset[Stream]) -> Iterator[TileBlocks]:
        """The blocks of each tile. When all streams are wanted they are read ahead, neighbours in one request."""
        found = (self.container.tile_entries(tile, layers) for tile in tiles)
        if not streams >= ALL_STREAMS:
            yield from ([(entry, None) for entry in entries] for entries in found)
            return
        for batch in batches(found, lambda row: sum(entry.length for entry in row if entry), PREFETCH_BYTES):
            entries = sorted({entry for row in batch for entry in row if entry is not None}, key=lambda e: e.offset)
            # Verified later, tile by tile: damage to one must not keep back those before it.
            payloads = dict(self.container.read_blocks(entries, verify=False))
            yield from ([(entry, payloads[entry] if entry else None) for entry in row] for row in batch)

    def tile(
        self,
        models: SceneModels,
        tile: int,
        blocks: TileBlocks,
        streams: frozenset[Stream],
        observe: Observe | None = None,
    ) -> TileContent:
        """A tile after the models' last layer, from its blocks of :meth:`supply`; the rest as for :meth:`tiles`."""
        # A table of a few bytes can list many tiles of which nothing else is said.
        if not any(entry for entry, _ in blocks):
            return TileContent.empty(models.model)
        model, neural = models.model, self._neural(models, Stream.INDICES in streams)
        # A layer's predictors may look at what only earlier layers send: what is needed last is needed first.
        streams = streams | find_needed(model, streams, neural[-1])
        frame = tile_frame(self.header.fields, self.container.tile(tile))
        sizes = models.codebooks.sizes if models.codebooks else (0, 0)
        content = TileContent.empty(model, sum(entry.count for entry, _ in blocks if entry))
        known = 0
        stages = zip(models.tables, neural, blocks, strict=True)
        for layer, (tables, beside, (entry, payload)) in enumerate(stages, start=1):
            new = entry.count if entry else 0
            known += new
            if entry is None and not known:
                continue
            observer = observe(tile, layer) if observe is not None else None
            parts = self._substreams(entry, payload, model, streams) if entry else {}
            decode = partial(
                get_layer,
                model,
                layer,
                frame,
                content.head(known),
                new,
                partial(_open_stream, parts, tables, observer),
                streams,
                sizes,
                beside,
                observer,
            )
            if entry is None:
                decode()
            else:
                run_at(entry, decode)
        return content

    def _substreams(
        self, entry: Entry, payload: bytes | None, model: SceneModel, streams: frozenset[Stream]
    ) -> dict[Stream, bytes]:
        """The bytes of the sub-streams needed: from the whole block where it was read, else by ranges."""
        if payload is None:
            data, wanted = self.read_parts(entry, streams, model), streams | _ALWAYS
        else:
            check_crc(entry, zlib.crc32(payload))
            data, wanted = payload, ALL_STREAMS
        table = run_at(entry, lambda: table_of(data, entry, model))
        return {
            kind: _check(entry, kind, part, data[part.start : part.start + part.length])
            for kind, part in table.items()
            if kind in wanted
        }

    def read_parts(self, entry: Entry, streams: frozenset[Stream], model: SceneModel) -> bytes:
        """A block of which only the table and the sub-streams needed are read, zeros elsewhere.

        Raises:
            Malformed: the table is refused.
        """
        out = bytearray(entry.length)
        head = self.container.read_range(entry, 0, min(entry.length, MAX_TABLE_SIZE))
        out[: len(head)] = head
        table = run_at(entry, lambda: table_of(head, entry, model))
        for kind in sorted((streams | _ALWAYS) & set(table)):
            start, length = table[kind].start, table[kind].length
            out[start : start + length] = self.container.read_range(entry, start, length)
        return bytes(out)


def batches(items: Iterable[T], size_of: Callable[[T], int], most: int) -> Iterator[list[T]]:
    """Consecutive items whose sizes are at most so much together, or one item."""
    batch, size = list[T](), 0
    for item in items:
        more = size_of(item)
        if batch and size + more > most:
            yield batch
            batch, size = [], 0
        batch.append(item)
        size += more
    if batch:
        yield batch


def table_of(head: bytes, entry: Entry, model: SceneModel) -> dict[Stream, Substream]:
    """The sub-stream table of a TILE block, of which nothing may go unread.

    Raises:
        Malformed: ``bad-substream-table``, also for a sub-stream that codes nothing in this block (SPEC §7.1).
    """
    table = unpack_table(head, entry.length)
    idle = set(table) - list_coded(model, entry.count)
    if idle:
        message = f"sub-stream {min(idle).name} codes nothing in this block (SPEC §7.1)"
        raise Malformed("bad-substream-table", message, field="substreams")
    return table


def _check(entry: Entry, kind: Stream, part: Substream, data: bytes) -> bytes:
    return run_at(entry, lambda: check_substream(kind, part, data))


def _open_stream(
    parts: dict[Stream, bytes], tables: dict[TableKey, SymbolTable], observer: LayerObserver | None, stream: Stream
) -> SymbolReader:
    """The reader of a sub-stream of one layer of one tile."""
    data = parts.get(stream, b"")
    return SymbolReader(data, tables) if observer is None else ObservedReader(data, tables, stream, observer)
