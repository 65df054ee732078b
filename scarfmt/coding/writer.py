"""From a quantised scene to the bytes of a file (SPEC §5-§8). The reference encoder decides, this writes.

A layer's symbols are gathered from all tiles first; the tables fitted to them then code them.
A layer's TABLES block holds a table only where that is cheaper than going on with an earlier layer's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from scarfmt.arrays import I64, Ints
from scarfmt.blocks.mlp import QuantisedMlp
from scarfmt.blocks.registry import BLOCKS
from scarfmt.blocks.spec import Writing
from scarfmt.blocks.streaming import Streaming
from scarfmt.blocks.tables import fit_table, table_bits
from scarfmt.codecs.channels import coarsen
from scarfmt.coding.checks_of_scene import check_books, check_content
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.tile import NeuralModels, TileContent, put_layer
from scarfmt.container.directory import local_bits, tile_frame
from scarfmt.container.file import Block, HeaderFields, Tile, write_container
from scarfmt.container.schema import BlockKind, Profile, Stream
from scarfmt.container.source import BytesSource
from scarfmt.container.substreams import pack_substreams
from scarfmt.entropy.emitters import SymbolCounter
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.recorded import RecordedSymbols, SymbolRecorder
from scarfmt.entropy.symbol_tables import StaticTables, SymbolTable
from scarfmt.errors import InvalidInput, ScarError
from scarfmt.limits import FORMAT_LIMITS
from scarfmt.neural.evaluator import Evaluator
from scarfmt.neural.grid import HashGrid
from scarfmt.neural.network import IndexNetwork
from scarfmt.neural.predictors import Predictor
from scarfmt.scene.model import Codebooks, SceneModel

Report = Callable[[str, float], None]
Histogram = Mapping[TableKey, tuple[I64, I64]]
"""By table, its alphabet, ascending, and how often each value of it comes; both (m,) int64."""


def silent(_stage: str, _fraction: float) -> None:
    """A progress report that goes nowhere."""


@dataclass(frozen=True)
class QuantisedScene:
    """All integers and models of a scene: exactly what a file holds.

    Attributes:
        fields: header fields.
        model: channels, layers, classes.
        tiles, contents: tile table and the content of each, at the last layer.
        codebooks: None when no stage is used.
        decoder: latent to SH or feature; None when no stage is used.
        scene_mlps: opacity, covariance and colour networks of the anchor profile, else empty.
        metadata: JSON-able annotations, or empty.
        predictors: per layer (1-based), those whose step first travels in it.
        network: the index network; needed exactly when a layer's row is neural.
        grid: the hash grid the network reads, or None.
        streaming: what tells a client what to fetch first, or None.
    """

    fields: HeaderFields
    model: SceneModel
    tiles: tuple[Tile, ...]
    contents: tuple[TileContent, ...]
    codebooks: Codebooks | None = None
    decoder: QuantisedMlp | None = None
    scene_mlps: tuple[QuantisedMlp, ...] = ()
    metadata: Mapping[str, Any] = field(default_factory=dict)
    predictors: Mapping[int, tuple[Predictor, ...]] = field(default_factory=dict)
    network: IndexNetwork | None = None
    grid: HashGrid | None = None
    streaming: Streaming | None = None

    def neural(self, layer: int) -> NeuralModels:
        """The models that code symbols beside static tables in a layer."""
        found = {p.key: p for number, group in self.predictors.items() if number <= layer for p in group}
        return NeuralModels(found, self._coder)

    @cached_property
    def _coder(self) -> Evaluator | None:
        if self.network is None or self.codebooks is None:
            return None
        return Evaluator(self.network, self.codebooks, self.grid)


def model_blocks(scene: QuantisedScene, layer: int, tables: Mapping[TableKey, SymbolTable]) -> Iterator[Block]:
    """The blocks of a layer that belong to no tile, in file order; `tables` are those that the layer sends."""
    for spec in BLOCKS.values():
        here = spec.layers is None or layer in spec.layers(scene.model)
        value = spec.taken(Writing(scene, layer, tables)) if here else None
        if value is not None:
            yield Block(spec.kind, layer, spec.pack(value), count=spec.count(value))


def fit_tables(histograms: Histogram, known: Mapping[TableKey, SymbolTable]) -> dict[TableKey, SymbolTable]:
    """Tables worth sending in a layer with these symbols, given those of earlier layers.

    Args:
        histograms: by table, keys ascending.
    """
    sent: dict[TableKey, SymbolTable] = {}
    for key, (alphabet, counts) in histograms.items():
        table = fit_table(alphabet, counts)
        if key in known:
            own = float((table.table.bits * counts).sum()) + table_bits(table)
            if known[key].cost_of_counts(alphabet, counts) <= own:
                continue
        sent[key] = table
    return sent


@dataclass(frozen=True)
class RecordedTile:
    """One layer of one tile before it is coded: how many anchors are new, and the symbols of every stream."""

    new: int
    streams: dict[Stream, RecordedSymbols]

    def block(self, layer: int, tile: int, tables: Mapping[TableKey, SymbolTable]) -> Block | None:
        """The TILE block, None where there is nothing to say.

        Args:
            tables: in force in the layer.
        """
        streams = {stream: symbols.code(tables) for stream, symbols in self.streams.items()}
        if not self.new and not any(streams.values()):
            return None
        sizes = {int(stream): len(data) for stream, data in streams.items()}
        return Block(BlockKind.TILE, layer, pack_substreams(streams), tile=tile, count=self.new, stream_bytes=sizes)


def record_tile(
    scene: QuantisedScene, layer: int, tile: int, neural: NeuralModels, counter: SymbolCounter
) -> RecordedTile:
    """One layer of one tile, its symbols counted by `counter`.

    Args:
        neural: of the scene and the layer.
    """
    recorders: dict[Stream, SymbolRecorder] = {}

    def recorder(stream: Stream) -> SymbolRecorder:
        return recorders.setdefault(stream, SymbolRecorder(counter))

    frame = tile_frame(scene.fields, scene.tiles[tile])
    new = put_layer(scene.model, layer, frame, scene.contents[tile], recorder, neural)
    return RecordedTile(new, {stream: one.settle() for stream, one in recorders.items()})


def _check(scene: QuantisedScene) -> None:
    try:
        scene.model.check()
    except ScarError as error:
        raise InvalidInput("input-container", f"the file would break a rule: {error}") from error
    if len(scene.tiles) != len(scene.contents):
        raise InvalidInput("input-container", "one content per tile is needed", field="contents")
    if scene.scene_mlps and scene.fields.profile != Profile.ANCHOR:
        raise InvalidInput("input-container", "only the anchor profile has networks of its own", field="scene_mlps")
    check_books(scene.model, scene.codebooks)
    for tile, content in zip(scene.tiles, scene.contents, strict=True):
        check_content(scene.model, scene.codebooks, local_bits(scene.fields, tile), content)


def write_scene(scene: QuantisedScene, report: Report = silent) -> bytes:
    """The bytes of a file. Equal scenes give equal bytes.

    Args:
        report: told (stage, fraction done).

    Raises:
        InvalidInput: ``input-container`` when the scene breaks a rule of SPEC.md, ``input-table`` when a channel
            takes more different values than a table holds.
    """
    return assemble_file(scene, code_blocks(scene, report))


def assemble_file(scene: QuantisedScene, blocks: Sequence[Block]) -> bytes:
    """The bytes of a file of these blocks.

    Raises:
        InvalidInput: ``input-container`` when they break a rule of SPEC.md.
    """
    data = write_container(scene.fields, scene.tiles, blocks, layer_counts(scene))
    # The reader's own rules are the writer's contract.
    try:
        SceneReader(BytesSource(data), limits=FORMAT_LIMITS).models()
    except ScarError as error:
        raise InvalidInput("input-container", f"the file would break a rule: {error}") from error
    return data


def code_blocks(scene: QuantisedScene, report: Report = silent) -> list[Block]:
    """All blocks of a file. For the arguments and errors see :func:`write_scene`."""
    _check(scene)
    layers = len(scene.model.layers)
    known = StaticTables()
    blocks: list[Block] = []
    for layer in range(1, layers + 1):
        counter, neural = SymbolCounter(), scene.neural(layer)
        recorded = []
        for tile in range(len(scene.tiles)):
            report("code", (layer - 1 + tile / len(scene.tiles)) / layers)
            recorded.append(record_tile(scene, layer, tile, neural, counter))
        sent = fit_tables(counter.histograms(), known)
        known = StaticTables({**known, **sent})
        blocks += model_blocks(scene, layer, sent)
        coded = (each.block(layer, tile, known) for tile, each in enumerate(recorded))
        blocks += [block for block in coded if block is not None]
    report("code", 1.0)
    return blocks


def layer_counts(scene: QuantisedScene) -> list[tuple[int, int]]:
    """Per layer, cumulative (anchors, Gaussians)."""
    out = []
    for layer, row in enumerate(scene.model.layers, start=1):
        anchors = sum(int((content.classes < row.class_count).sum()) for content in scene.contents)
        gaussians = anchors
        if scene.fields.profile == Profile.ANCHOR:
            shown = ((c.slot_layers > 0) & (c.slot_layers <= layer) for c in scene.contents)
            gaussians = sum(int(mask.sum()) for mask in shown)
        out.append((anchors, gaussians))
    return out


def keep_layers(scene: QuantisedScene, layers: int) -> QuantisedScene:
    """A scene cut to its first `layers` layers, models unchanged.

    ``write_scene(keep_layers(scene, k))`` is byte-equal to truncating ``write_scene(scene)`` (SPEC §14).
    """
    model = replace(scene.model, layers=scene.model.layers[:layers])
    contents = tuple(_content_at(scene.model, model, content) for content in scene.contents)
    return replace(scene, model=model, contents=contents)


def _content_at(full: SceneModel, model: SceneModel, content: TileContent) -> TileContent:
    layer, last = len(model.layers), len(full.layers)
    kept = content.classes < model.layers[-1].class_count
    classes, slot_layers = content.classes[kept], content.slot_layers[kept]
    slot_layers[slot_layers > layer] = 0
    values = []
    for index, channel in enumerate(model.channels):
        here: Ints = content.values[index][kept]
        if channel.per_slot:
            here = here * (slot_layers > 0)[:, :, None]
        else:
            now, final = model.steps(layer, index, classes), full.steps(last, index, classes)
            here = coarsen(here, (final - now)[:, None]) * (now > 0)[:, None]
        values.append(here.astype(np.int32))
    received = model.stages(layer, classes)
    indices = content.indices[kept][:, : model.max_stages]
    indices = np.where(np.arange(model.max_stages) < received[:, None], indices, 0).astype(np.int16)
    return TileContent(content.codes[kept], classes, values, indices, slot_layers)
