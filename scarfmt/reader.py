"""From the bytes of a file to exact tile contents (SPEC §5-§8): what a decoder does before any float.

:class:`SceneReader` reads only the blocks, and within a block only the sub-streams, that the layers, tiles
and attributes asked for need.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from scarfmt.bytefields import decompress
from scarfmt.codecs.codebooks import Codebooks, unpack_codebooks
from scarfmt.codecs.layer import unpack_layer
from scarfmt.codecs.mlp import Network, unpack_networks
from scarfmt.container import Container, Entry
from scarfmt.directory import block_name
from scarfmt.errors import InvalidInput, Malformed, ScarError, Truncated
from scarfmt.limits import DEFAULT_LIMITS, Limits
from scarfmt.model import Channel, Lattice, LayerRow, SceneModel
from scarfmt.schema import BlockKind, Profile, Stream
from scarfmt.source import ByteSource
from scarfmt.substreams import MAX_TABLE_SIZE, Substream, check_substream, unpack_table
from scarfmt.symbols import SymbolReader, SymbolTable, TableKey, unpack_tables
from scarfmt.tile import TileContent, coded_streams, get_layer, needed_channels
from scarfmt.writer import first_layers, local_bits

ALL_STREAMS = frozenset(Stream) - {Stream.MODELS, Stream.FRAMING}
MAX_TABLES_BYTES = 64 << 20

T = TypeVar("T")


@dataclass(frozen=True)
class SceneModels:
    """Everything of a file's first `layers` layers that belongs to no tile.

    Attributes:
        model: channels, classes and layer rows.
        tables: static tables in force in each layer.
        codebooks: with empty books where none is sent; None when no stage is used.
        decoder: latent to SH or feature, or None.
        scene_mlps: networks of the anchor profile.
    """

    model: SceneModel
    tables: tuple[dict[TableKey, SymbolTable], ...]
    codebooks: Codebooks | None
    decoder: Network | None
    scene_mlps: tuple[Network, ...]


class SceneReader:
    """Reads models and tiles of one file.

    Args:
        source: the file.
        limits: what the caller accepts.
        allow_truncated: use the whole layers of a cut file instead of refusing it.
    """

    def __init__(self, source: ByteSource, *, limits: Limits = DEFAULT_LIMITS, allow_truncated: bool = False) -> None:
        self.container = Container.open(source, limits=limits, allow_truncated=allow_truncated)
        self.header = self.container.header
        self.lattice = Lattice(self.header.fields.origin, self.header.fields.voxel, self.header.fields.lattice_bits)
        self.container.load()

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
            raise InvalidInput("input-layers", f"layer {layers} asked for, the file has 1..{self.layers}")
        return layers

    def _block(self, kind: BlockKind, layer: int, parse: Callable[[bytes], T]) -> T | None:
        entry = self.container.find(kind, layer)
        if entry is None:
            return None
        payload = self.container.read_block(entry)
        return _placed(entry, lambda: parse(payload))

    def _required(self, kind: BlockKind, layer: int, parse: Callable[[bytes], T]) -> T:
        parsed = self._block(kind, layer, parse)
        if parsed is None:
            raise Malformed("missing-block", f"layer {layer} needs a {kind.name} block (SPEC §6.5)", field=kind.name)
        return parsed

    def models(self, layers: int | None = None) -> SceneModels:
        """All model blocks of the first `layers` layers (None: all).

        Raises:
            Malformed: a block is missing or breaks its rules.
        """
        count = self.layer_number(layers)
        fields = self.header.fields
        rows: list[LayerRow] = []
        channels: tuple[Channel, ...] = ()
        tables: list[dict[TableKey, SymbolTable]] = []
        for layer in range(1, count + 1):
            row, channels = self._required(
                BlockKind.LAYER, layer, lambda data, layer=layer, channels=channels: unpack_layer(data, layer, channels)
            )
            rows.append(row)
            new = self._block(BlockKind.TABLES, layer, _tables_from)
            tables.append({**(tables[-1] if tables else {}), **(new or {})})
        model = SceneModel(fields.profile, fields.slots, channels, tuple(rows))
        model.check()
        self._refuse_unexpected(model)
        books, decoder = self._latent_models(model)
        mlps = self._block(BlockKind.SCENE_MLP, 1, unpack_networks) or ()
        return SceneModels(model, tuple(tables), books, decoder, mlps)

    def _refuse_unexpected(self, model: SceneModel) -> None:
        """A model block no layer needs would be read by one decoder and skipped by another (SPEC §7.8-7.9)."""
        coarse, residual, decoder = first_layers(model)
        needed = {(BlockKind.CODEBOOKS, coarse), (BlockKind.CODEBOOKS, residual), (BlockKind.DECODER_MLP, decoder)}
        if model.profile == Profile.ANCHOR:
            needed.add((BlockKind.SCENE_MLP, 1))
        for layer in range(1, len(model.layers) + 1):
            for kind in (BlockKind.CODEBOOKS, BlockKind.DECODER_MLP, BlockKind.SCENE_MLP):
                entry = self.container.find(kind, layer)
                if entry is not None and (kind, layer) not in needed:
                    message = "nothing first needs this block in its layer (SPEC §7.8-7.9)"
                    raise Malformed("unexpected-block", message, offset=entry.offset, field=block_name(entry))

    def _latent_models(self, model: SceneModel) -> tuple[Codebooks | None, Network | None]:
        starts = first_layers(model)
        if starts[2] is None:
            return None, None
        networks = self._required(BlockKind.DECODER_MLP, starts[2], unpack_networks)
        dimension = networks[0].inputs if len(networks) == 1 else 0
        for channel in model.channels:
            if channel.stream == Stream.LATENT and channel.components != dimension:
                raise Malformed("bad-mlp", "the decoder does not take the latent channel (SPEC §7.9)", field="decoder")
        if starts[0] is None:
            return None, networks[0]
        books: dict[int, NDArray[np.int64]] = {}
        for layer in sorted({start for start in starts[:2] if start is not None}):
            here = self._required(BlockKind.CODEBOOKS, layer, unpack_codebooks)
            # Exactly the books first needed here: else a cut file would be refused where the whole one is read.
            if set(here) != {number for number in (0, 1) if starts[number] == layer}:
                raise Malformed("bad-codebook", "codebooks do not match the stages used (SPEC §7.8)", field="codebooks")
            books.update(here)
        if {words.shape[1] for words in books.values()} != {dimension}:
            raise Malformed("bad-mlp", "the decoder does not take the codewords (SPEC §7.9)", field="decoder")
        residual = books.get(1, np.zeros((0, dimension), np.int64))
        return Codebooks(books[0], residual), networks[0]

    def tiles(
        self,
        models: SceneModels,
        tiles: Sequence[int] | None = None,
        streams: Collection[Stream] = ALL_STREAMS,
        threads: int = 1,
    ) -> Iterator[tuple[int, TileContent]]:
        """(tile index, content after the models' last layer) of each tile asked for, in that order.

        Args:
            models: from :meth:`models`; fixes the layer.
            tiles: tile indices, None for all. Tiles without anchors are yielded empty.
            streams: attribute streams wanted; others are not read and their values stay 0.
            threads: tiles decoded side by side; the result does not depend on it.
        """
        chosen = range(self.header.tile_count) if tiles is None else tiles

        def one(tile: int) -> TileContent:
            return self._tile(models, tile, streams)

        if threads <= 1:
            yield from ((tile, one(tile)) for tile in chosen)
            return
        with ThreadPoolExecutor(threads) as pool:
            ahead: deque[tuple[int, Future[TileContent]]] = deque()
            try:
                for tile in chosen:
                    ahead.append((tile, pool.submit(one, tile)))
                    # A slow consumer must not let all tiles of a scene pile up.
                    if len(ahead) > 2 * threads:
                        done, content = ahead.popleft()
                        yield done, content.result()
                while ahead:
                    done, content = ahead.popleft()
                    yield done, content.result()
            finally:
                for _, content in ahead:
                    content.cancel()

    def _tile(self, models: SceneModels, tile: int, streams: Collection[Stream]) -> TileContent:
        model = models.model
        bits = local_bits(self.header.fields, self.container.tiles[tile])
        sizes = models.codebooks.sizes if models.codebooks else (0, 0)
        content = TileContent.empty(model)
        for layer, tables in enumerate(models.tables, start=1):
            entry = self.container.find(BlockKind.TILE, layer, tile)
            if entry is None and not len(content):
                continue
            parts = {} if entry is None else self._substreams(entry, model, streams)
            new = 0 if entry is None else entry.count
            open_stream = _opener(parts, tables)
            decode = _Bound(model, layer, bits, content, new, open_stream, streams, sizes)
            content = decode() if entry is None else _placed(entry, decode)
        return content

    def _substreams(self, entry: Entry, model: SceneModel, streams: Collection[Stream]) -> dict[Stream, bytes]:
        """The bytes of the sub-streams needed: the whole block when that is all of them, else ranges."""
        need = needed_channels(model, streams)
        wanted = {Stream.POSITIONS, Stream.CLASSES, Stream.MASKS} | (set(streams) & {Stream.INDICES})
        wanted |= {channel.stream for channel, needed in zip(model.channels, need, strict=True) if needed}
        if set(streams) >= ALL_STREAMS:
            block = self.container.read_block(entry)
            table = _placed(entry, lambda: _table_of(block, entry, model))
            return {
                kind: _placed(entry, lambda kind=kind, part=part: check_substream(kind, part, _cut(block, part)))
                for kind, part in table.items()
            }
        head = self.container.read_range(entry, 0, min(entry.length, MAX_TABLE_SIZE))
        table = _placed(entry, lambda: _table_of(head, entry, model))
        out = {}
        for kind in wanted & set(table):
            part = table[kind]
            data = self.container.read_range(entry, part.start, part.length)
            out[kind] = _placed(entry, lambda kind=kind, part=part, data=data: check_substream(kind, part, data))
        return out


@dataclass(frozen=True)
class _Bound:
    """One call of get_layer, to be made inside an error frame."""

    model: SceneModel
    layer: int
    bits: int
    content: TileContent
    new: int
    open_stream: Callable[[Stream], SymbolReader]
    streams: Collection[Stream]
    sizes: tuple[int, int]

    def __call__(self) -> TileContent:
        return get_layer(
            self.model, self.layer, self.bits, self.content, self.new, self.open_stream, self.streams, self.sizes
        )


def _table_of(head: bytes, entry: Entry, model: SceneModel) -> dict[Stream, Substream]:
    """The sub-stream table of a TILE block, of which nothing may go unread."""
    table = unpack_table(head, entry.length)
    idle = set(table) - coded_streams(model, entry.count)
    if idle:
        message = f"sub-stream {min(idle).name} codes nothing in this block (SPEC §7.1)"
        raise Malformed("bad-substream-table", message, field="substreams")
    return table


def _cut(block: bytes, part: Substream) -> bytes:
    return block[part.start : part.start + part.length]


def _opener(parts: dict[Stream, bytes], tables: dict[TableKey, SymbolTable]) -> Callable[[Stream], SymbolReader]:
    return lambda stream: SymbolReader(parts.get(stream, b""), tables)


def _tables_from(payload: bytes) -> dict[TableKey, SymbolTable]:
    return unpack_tables(decompress(payload, MAX_TABLES_BYTES, "tables"))


def _placed(entry: Entry, act: Callable[[], T]) -> T:
    """Run `act`; an error without an offset gets that of the block it came from."""
    try:
        return act()
    except ScarError as error:
        if error.offset is not None:
            raise
        raise type(error)(error.refusal, error.message, offset=entry.offset, field=error.field) from error
