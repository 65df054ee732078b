"""From the bytes of a file to exact tile contents (SPEC §5-§8): what a decoder does before any float.

:class:`SceneReader` reads only the blocks, and within a block only the sub-streams, that the layers, tiles
and attributes asked for need.
"""

from __future__ import annotations

import itertools
import zlib
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from copy import copy
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np

from scarfmt.arrays import I64
from scarfmt.blocks.registry import MODEL_BLOCKS
from scarfmt.coding.engine import NUMPY_ENGINE, Engine, WholeTiles
from scarfmt.coding.models import ModelBlocks, SceneModels, load_models, placed
from scarfmt.coding.tile import NeuralModels, TileContent, coded_streams, get_layer, needed_streams
from scarfmt.coding.work import Contents, Extent, check_work, extent
from scarfmt.container.directory import tile_frame
from scarfmt.container.file import COALESCE_BYTES, Container, Entry, check_crc
from scarfmt.container.schema import Stream
from scarfmt.container.source import ByteSource
from scarfmt.container.substreams import MAX_TABLE_SIZE, Substream, check_substream, unpack_table
from scarfmt.counters import Counters
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.symbol_reader import SymbolReader
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.errors import InvalidInput, Malformed, Truncated
from scarfmt.limits import DEFAULT_LIMITS, Limits
from scarfmt.neural.products import NetworkWork
from scarfmt.observe import LayerObserver, Observe, ObservedReader
from scarfmt.scene.model import Lattice, SceneModel

ALL_STREAMS = frozenset(Stream) - {Stream.MODELS, Stream.FRAMING}
PREFETCH_BYTES = COALESCE_BYTES
"""Tiles are read ahead, all their layers, up to this size: few requests, and bounded memory."""

T = TypeVar("T")
Act = Callable[[int, TileContent, Counters | None], T]
# Per layer, a tile's block, if it has one, and its bytes, if they were read ahead.
TileBlocks = Sequence[tuple[Entry | None, bytes | None]]


@dataclass(frozen=True)
class _Wanted:
    """The part of a file that is read: the arguments of :meth:`SceneReader.tiles`."""

    models: SceneModels
    tiles: list[int]
    streams: frozenset[Stream]
    observe: Observe | None
    counters: Counters | None
    brief: bool = False


def _content(_tile: int, content: TileContent, _counters: Counters | None) -> TileContent:
    return content


class SceneReader:
    """Reads models and tiles of one file.

    Args:
        source: the file.
        limits: what the caller accepts.
        allow_truncated: use the whole layers of a cut file instead of refusing it.
        engine: what computes; whichever it is, the result is the same.

    Attributes:
        engine: as given.
    """

    def __init__(
        self,
        source: ByteSource,
        *,
        limits: Limits = DEFAULT_LIMITS,
        allow_truncated: bool = False,
        engine: Engine = NUMPY_ENGINE,
    ) -> None:
        self.engine = engine
        self._prepared: tuple[tuple[SceneModels, bool], tuple[NeuralModels, ...]] | None = None
        self._whole: tuple[tuple[NeuralModels, ...], WholeTiles | None] | None = None
        self.container = Container.open(source, limits=limits, allow_truncated=allow_truncated)
        self.header = self.container.header
        self.lattice = Lattice(self.header.fields.origin, self.header.fields.voxel, self.header.fields.lattice_bits)
        # What lies behind it is read as it is needed; that it is there shows here.
        _ = self.container.root

    def twin(self) -> SceneReader:
        """A second reader of the same opened file. It prepares its models in a cache of its own."""
        other = copy(self)
        other._prepared = other._whole = None
        return other

    @property
    def layers(self) -> int:
        """Whole layers that can be read."""
        return self.container.available_layers

    def layer_number(self, layers: int | None) -> int:
        """`layers` checked against the file; None means all.

        Raises:
            InvalidInput: ``input-layers``.
            Truncated: ``truncated-block`` when a cut file holds no whole layer.
        """
        if self.layers == 0:
            raise Truncated("truncated-block", "the file was cut inside its first layer: nothing can be decoded")
        if layers is None:
            return self.layers
        if not 1 <= layers <= self.layers:
            raise InvalidInput("input-layers", f"layer {layers} is not in 1..{self.layers}, the layers of the file")
        return layers

    def _model_blocks(self, layers: int) -> ModelBlocks:
        """The model blocks of the first `layers` layers; those of one layer, being neighbours, in one request."""
        kinds = [spec.kind for spec in MODEL_BLOCKS]
        entries = [self.container.find(kind, layer) for layer in range(1, layers + 1) for kind in kinds]
        payloads = dict(self.container.read_blocks(entry for entry in entries if entry is not None))
        contents = Contents(self.header.file_length, self.container.limits)
        return ModelBlocks(payloads, contents.decompress)

    def models(
        self, layers: int | None = None, counters: Counters | None = None, tiles: Sequence[int] | None = None
    ) -> SceneModels:
        """All model blocks of the first `layers` layers (None: all), added to `counters`.

        What the directory says of the tiles in those layers is read before, in few requests.

        Args:
            layers: to decode.
            counters: blocks are added to them.
            tiles: that will be decoded with them, whose work is bounded; None for all.

        Raises:
            Malformed: the directory is refused; a block is missing or breaks its rules.
            LimitExceeded: ``limit-work``, ``limit-expansion`` beside the limits of the directory and of blocks.
            InvalidInput: ``input-layers``, ``input-tiles``.
        """
        count = self.layer_number(layers)
        chosen = np.array(self.check_tiles(tiles), np.int64)
        self.container.load(count, tiles)
        blocks = self._model_blocks(count)
        if counters is not None:
            counters.model_blocks += len(blocks)
        models = load_models(self.header.fields, count, blocks)
        check_work(models.work.total(self.extent(count, chosen)), self.header.file_length, self.container.limits)
        return models

    def extent(self, layers: int, tiles: I64) -> Extent:
        """The totals that the directory declares for some tiles in the first layers. Reads their pages."""
        counts, rows = self.container.tile_counts(layers, tiles), self.container.tile_rows(tiles)
        return extent(counts, rows, self.header.fields.lattice_bits)

    def tiles(
        self,
        models: SceneModels,
        tiles: Sequence[int] | None = None,
        streams: Collection[Stream] = ALL_STREAMS,
        threads: int = 1,
        observe: Observe | None = None,
        counters: Counters | None = None,
    ) -> Iterator[tuple[int, TileContent]]:
        """(tile index, content after the models' last layer) of each tile asked for, in that order.

        Args:
            models: from :meth:`models`; fixes the layer.
            tiles: tile indices, None for all. Tiles without anchors are yielded empty.
            streams: attribute streams wanted; others are not read and their values stay 0.
            threads: tiles decoded side by side; the result does not depend on it.
            observe: gives the observers of what is computed on the way.
            counters: the work of a tile is added before it is yielded; bytes are not, the source counts those.

        Raises:
            InvalidInput: ``input-tiles`` for an index the file does not have; at once, before anything is read.
        """
        wanted = _Wanted(models, self.check_tiles(tiles), frozenset(streams), observe, counters)
        return self._decoded(wanted, threads, _content)

    def each_tile(
        self,
        models: SceneModels,
        act: Act[T],
        tiles: Sequence[int] | None = None,
        streams: Collection[Stream] = ALL_STREAMS,
        threads: int = 1,
        counters: Counters | None = None,
    ) -> Iterator[tuple[int, T]]:
        """The result of `act` for each tile, computed in the thread that decoded the tile. For the arguments see
        :meth:`tiles`.

        Args:
            act: is given the tile's index, its content and the counters of its work, if there are any. The content
                may change once it returns, and lack first-step values where no context looks at them.
        """
        wanted = _Wanted(models, self.check_tiles(tiles), frozenset(streams), None, counters, brief=True)
        return self._decoded(wanted, threads, act)

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

    def _decoded(self, wanted: _Wanted, threads: int, act: Act[T]) -> Iterator[tuple[int, T]]:
        models, streams, counters = wanted.models, wanted.streams, wanted.counters
        neural = self._neural(models, Stream.INDICES in streams, counters)
        whole = self._whole_tiles(models, neural) if wanted.observe is None and streams >= ALL_STREAMS else None
        # A layer's predictors may look at what only earlier layers send: what is needed last is needed first.
        needed = streams | needed_streams(models.model, streams, neural[-1])
        empty = TileContent.empty(models.model)

        def read(tile: int, blocks: TileBlocks, own: Counters | None) -> TileContent:
            # A table of a few bytes can list many tiles of which nothing else is said.
            if not any(entry for entry, _ in blocks):
                return empty
            content = self._whole_tile(whole, tile, blocks, own, wanted.brief) if whole is not None else None
            if content is not None:
                return content
            return self._tile(models, neural, tile, blocks, needed, wanted.observe, own)

        def one(tile: int, blocks: TileBlocks) -> tuple[T, Counters | None]:
            own = None if counters is None else Counters()
            return act(tile, read(tile, blocks, own), own), own

        def added(made: T, own: Counters | None) -> T:
            if counters is not None and own is not None:
                counters.add(own)
            return made

        supply = zip(wanted.tiles, self._supply(models, wanted.tiles, streams), strict=True)
        if threads <= 1:
            yield from ((tile, added(*one(tile, blocks))) for tile, blocks in supply)
            return
        with ThreadPoolExecutor(threads) as pool:
            ahead: deque[tuple[int, Future[tuple[T, Counters | None]]]] = deque()
            try:
                for tile, blocks in supply:
                    ahead.append((tile, pool.submit(one, tile, blocks)))
                    # A slow consumer must not let all tiles of a scene pile up.
                    if len(ahead) > 2 * threads:
                        done, content = ahead.popleft()
                        yield done, added(*content.result())
                while ahead:
                    done, content = ahead.popleft()
                    yield done, added(*content.result())
            finally:
                for _, content in ahead:
                    content.cancel()

    def _neural(self, models: SceneModels, indices: bool, counters: Counters | None) -> tuple[NeuralModels, ...]:
        """The models' networks, prepared; kept for whoever decodes tile after tile."""
        kept = self._prepared
        if kept is not None and kept[0][0] is models and kept[0][1] >= indices:
            return kept[1]
        neural = models.neural(self.engine, indices=indices)
        if neural[-1].indices is not None:
            NetworkWork(neural[-1].indices.network, counters).prepared(neural[-1].indices.books)
        self._prepared = (models, indices), neural
        return neural

    def _whole_tiles(self, models: SceneModels, neural: tuple[NeuralModels, ...]) -> WholeTiles | None:
        """The function that reads whole tiles. It is kept for callers that decode tile after tile."""
        if self._whole is None or self._whole[0] is not neural:
            self._whole = neural, self.engine.whole_tiles(models, neural)
        return self._whole[1]

    def _whole_tile(
        self, whole: WholeTiles, tile: int, blocks: TileBlocks, counters: Counters | None, brief: bool
    ) -> TileContent | None:
        """A tile read at once; None if it has a fault, which reading layer by layer then reports."""
        if any(entry and (payload is None or zlib.crc32(payload) != entry.crc32) for entry, payload in blocks):
            return None
        frame = tile_frame(self.header.fields, self.container.tile(tile))
        given = [(entry.count if entry else 0, payload) for entry, payload in blocks]
        content = whole.read(frame, given, counters, brief=brief)
        if content is not None and counters is not None:
            present = [entry is not None for entry, _ in blocks]
            counters.tile_blocks += sum(present)
            known = list(itertools.accumulate(count for count, _ in given))
            counters.visits += sum(known)
            counters.tiles, counters.anchors = 1, known[-1]
        return content

    def _supply(self, models: SceneModels, tiles: list[int], streams: frozenset[Stream]) -> Iterator[TileBlocks]:
        """The blocks of each tile. When all streams are wanted they are read ahead, neighbours in one request."""
        found = (self.container.tile_entries(tile, len(models.tables)) for tile in tiles)
        if not streams >= ALL_STREAMS:
            yield from ([(entry, None) for entry in entries] for entries in found)
            return
        for batch in _batches(found):
            entries = sorted({entry for row in batch for entry in row if entry is not None}, key=lambda e: e.offset)
            # Verified later, tile by tile: damage to one must not keep back those before it.
            payloads = dict(self.container.read_blocks(entries, verify=False))
            yield from ([(entry, payloads[entry] if entry else None) for entry in row] for row in batch)

    def _tile(
        self,
        models: SceneModels,
        neural: tuple[NeuralModels, ...],
        tile: int,
        blocks: TileBlocks,
        streams: frozenset[Stream],
        observe: Observe | None,
        counters: Counters | None,
    ) -> TileContent:
        model = models.model
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
            here, readers = content.head(known), _Readers(parts, tables, observer, self.engine)
            decode = partial(
                get_layer,
                model,
                layer,
                frame,
                here,
                new,
                readers.open,
                streams,
                sizes,
                beside,
                observer,
                counters,
                self.engine,
            )
            if entry is None:
                decode()
            else:
                placed(entry, decode)
            if counters is not None:
                readers.count(counters)
                counters.tile_blocks += entry is not None
                counters.visits += known
        if counters is not None:
            counters.tiles, counters.anchors = 1, known
        return content

    def _substreams(
        self, entry: Entry, payload: bytes | None, model: SceneModel, streams: frozenset[Stream]
    ) -> dict[Stream, bytes]:
        """The bytes of the sub-streams needed: from the whole block where it was read, else by ranges."""
        if payload is not None:
            check_crc(entry, zlib.crc32(payload))
            table = placed(entry, lambda: table_of(payload, entry, model))
            return {
                kind: _checked(entry, kind, part, payload[part.start : part.start + part.length])
                for kind, part in table.items()
            }
        wanted = streams | {Stream.POSITIONS, Stream.CLASSES, Stream.MASKS}
        head = self.container.read_range(entry, 0, min(entry.length, MAX_TABLE_SIZE))
        table = placed(entry, lambda: table_of(head, entry, model))
        out = {}
        for kind in wanted & set(table):
            part = table[kind]
            data = self.container.read_range(entry, part.start, part.length)
            out[kind] = _checked(entry, kind, part, data)
        return out


def _batches(rows: Iterable[list[Entry | None]]) -> Iterator[list[list[Entry | None]]]:
    """Consecutive tiles whose blocks have PREFETCH_BYTES together, or one tile."""
    batch: list[list[Entry | None]] = []
    size = 0
    for row in rows:
        more = sum(entry.length for entry in row if entry is not None)
        if batch and size + more > PREFETCH_BYTES:
            yield batch
            batch, size = [], 0
        batch.append(row)
        size += more
    if batch:
        yield batch


def table_of(head: bytes, entry: Entry, model: SceneModel) -> dict[Stream, Substream]:
    """The sub-stream table of a TILE block, of which nothing may go unread.

    Raises:
        Malformed: ``bad-substream-table``, also for a sub-stream that codes nothing in this block (SPEC §7.1).
    """
    table = unpack_table(head, entry.length)
    idle = set(table) - coded_streams(model, entry.count)
    if idle:
        message = f"sub-stream {min(idle).name} codes nothing in this block (SPEC §7.1)"
        raise Malformed("bad-substream-table", message, field="substreams")
    return table


def _checked(entry: Entry, kind: Stream, part: Substream, data: bytes) -> bytes:
    return placed(entry, lambda: check_substream(kind, part, data))


class _Readers:
    """The readers of one layer of one tile."""

    def __init__(
        self,
        parts: dict[Stream, bytes],
        tables: dict[TableKey, SymbolTable],
        observer: LayerObserver | None,
        engine: Engine,
    ) -> None:
        self._parts, self._tables, self._observer, self._engine = parts, tables, observer, engine
        self._opened: list[tuple[Stream, SymbolReader]] = []

    def open(self, stream: Stream) -> SymbolReader:
        data = self._parts.get(stream, b"")
        if self._observer is None:
            reader = self._engine.symbol_reader(data, self._tables)
        else:
            source = self._engine.rans_decoder(data)
            reader = ObservedReader(data, self._tables, stream, self._observer, source)
        self._opened.append((stream, reader))
        return reader

    def count(self, counters: Counters) -> None:
        """Add the symbols read."""
        for stream, reader in self._opened:
            counters.read(stream, reader)
