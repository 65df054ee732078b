"""Compiled reading of whole tiles: all layers in one call (SPEC §7)."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from scarfmt.arrays import I32, I64
from scarfmt.codecs import positions
from scarfmt.codecs.channels import width_table
from scarfmt.codecs.classes import KEY as CLASSES
from scarfmt.coding.tile import NeuralModels, TileContent
from scarfmt.container.directory import TileFrame
from scarfmt.container.schema import Profile, Stream
from scarfmt.counters import Coding, Counters, Part
from scarfmt.entropy.keys import StepKey
from scarfmt.kernel import structs
from scarfmt.kernel.channel import packed_rules
from scarfmt.kernel.memory import address
from scarfmt.kernel.packed_predictors import PackedPredictorSet
from scarfmt.kernel.packed_tables import PackedStaticTables
from scarfmt.kernel.scratch import SCRATCH
from scarfmt.neural.predictors import Predictor
from scarfmt.scene.model import MAX_CLASSES, SceneModel

if TYPE_CHECKING:
    from scarfmt.coding.models import SceneModels

TILE_READ = 0
"""The library's answer for a tile that it has read. After any other answer the definition reads the tile, to find the
fault."""

Blocks = Sequence[tuple[int, bytes | None]]
"""Per layer: anchors of a tile that appear in it, and its block, if it has one."""


class KernelTiles:
    """Reads whole tiles of one file, up to some layer. Threads may share one.

    Args:
        library: the compiled library.
        models: of the file; see :func:`can_read`.
        neural: per layer, predictors in force.
    """

    def __init__(self, library: ctypes.CDLL, models: SceneModels, neural: Sequence[NeuralModels]) -> None:
        self._library, self._model, self._neural = library, models.model, neural
        self._kept: list[Any] = []
        model = self._model
        depths = model.context.occupancies
        self._sources = {rule.source_channel for channel in model.channels for rule in channel.rules}
        self._struct = struct = structs.TileModel(len(model.channels), len(model.layers), model.max_stages)
        struct.attributes = sum(model.channels[index].components for index in model.attributes)
        struct.passes_log2, struct.depths = model.context.passes_log2, len(depths)
        struct.targets[: len(depths)] = depths
        struct.sizes[:] = models.codebooks.sizes if models.codebooks else (0, 0)
        columns = tuple(channel.components for channel in model.channels)
        for index, channel in enumerate(model.channels):
            rules, _ = packed_rules(channel.rules, columns)
            widths = width_table(channel.first_width)
            out = struct.channel[index]
            out.stream, out.components = channel.stream, channel.components
            out.attribute, out.residual = index in model.attributes, channel.stream == Stream.POSITION_RESIDUAL
            out.rules, out.widths = ctypes.addressof(rules), address(widths, np.float64)
            self._kept += rules, widths
        layers = (structs.TileLayer * len(model.layers))()
        for number, out in enumerate(layers, start=1):
            self._fill_layer(out, number, models.tables[number - 1].kept(PackedStaticTables))
        struct.layer = layers
        struct.predicted = any(layer.predicted for layer in layers)
        self._kept.append(layers)

    def _fill_layer(self, out: structs.TileLayer, number: int, tables: PackedStaticTables) -> None:
        model, every = self._model, np.arange(MAX_CLASSES + 1)
        out.first_class, out.past_class = model.first_new_class(number), model.layers[number - 1].class_count
        out.stages[:] = model.stages(number, every).tolist()
        predictors = self._neural[number - 1].sets
        for index, channel in enumerate(model.channels):
            before, after = model.steps(number - 1, index, every), model.steps(number, index, every)
            out.steps[index][:] = after.tolist()
            moving = np.flatnonzero(before < after)
            start, stop = (int(before[moving].min()) + 1, int(after[moving].max()) + 1) if len(moving) else (1, 1)
            coded = range(start, stop)
            out.start[index], out.stop[index] = start, stop
            packed = tables.steps(channel.stream, channel.components, coded)
            out.tables[index] = ctypes.addressof(packed.array)
            self._kept.append(packed)
            if any(predictors.step(channel.stream, step) for step in coded):
                kept = predictors.kept(PackedPredictorSet)
                steps = kept.steps(channel.stream, coded, channel.components, self._struct.depths)
                out.predictors[index], out.predicted = ctypes.addressof(steps.array), True
                self._kept.append(steps)
        out.positions, out.classes = (_table(tables, key) for key in (positions.KEY, _CLASSES))
        for stage in range(1, model.max_stages + 1):
            out.indices[stage - 1] = _table(tables, StepKey(Stream.INDICES, (stage,), 0))

    def read(
        self, frame: TileFrame, blocks: Blocks, counters: Counters | None = None, *, brief: bool = False
    ) -> TileContent | None:
        """The content of a tile after the last layer; None where it breaks a rule, or is too large for one call.

        Args:
            frame: of the tile.
            blocks: a layer each, their checksums right.
            counters: of symbols and of the predictors' multiply-adds.
            brief: whether the content is looked at only until the thread's next tile, and first-step values only of
                channels that are context.
        """
        model, total = self._model, sum(count for count, _ in blocks)
        content, planes = _empty(model, total, brief, self._sources)
        tile = structs.Tile(total, frame.bits, (structs.TileBlock * len(blocks))())
        longest = 0
        for out, (count, payload) in zip(tile.blocks, blocks, strict=False):
            out.count = count
            if payload is not None:
                longest = max(longest, len(payload))
                out.bytes, out.length = ctypes.cast(ctypes.c_char_p(payload), ctypes.c_void_p), len(payload)
        tile.codes, tile.classes = address(content.codes, np.uint64), address(content.classes, np.int64)
        for index, plane in enumerate(planes):
            tile.values[index] = address(plane, np.int32)
            if content.first[index].shape[1]:
                tile.first[index] = address(content.first[index], np.int32)
        tile.indices = address(content.indices, np.int16)
        symbols = np.zeros((structs.STREAM_KINDS, 2), np.int64)
        received = np.zeros((len(model.layers), len(planes), structs.STEPS + 1), np.int64)
        tile.symbols, tile.received = symbols.ctypes.data, received.ctypes.data
        model_at = ctypes.byref(self._struct)
        memory = SCRATCH.at("tile", int(self._library.scar_tile_memory(model_at, total, longest)))
        if self._library.scar_tile(model_at, ctypes.byref(tile), longest, memory) != TILE_READ:
            return None
        if counters is not None:
            self._count(counters, symbols, received)
        return content

    def _count(self, counters: Counters, symbols: I64, received: I64) -> None:
        for stream, coding in np.argwhere(symbols):
            counters.symbols[Stream(stream), _CODINGS[coding]] += int(symbols[stream, coding])
        for neural, anchors in zip(self._neural, received, strict=True):
            for (stream, _, step), predictor in neural.predictors.items():
                channel = self._model.channel_index(Stream(stream))
                if channel is not None and isinstance(predictor, Predictor):
                    counters.multiply(Part.PREDICTORS, int(anchors[channel, step]), predictor.multiply_adds)


_CLASSES = StepKey(CLASSES.stream, (CLASSES.component,), CLASSES.step)
_CODINGS = (Coding.STATIC, Coding.UNIFORM)


def can_read(models: SceneModels, neural: Sequence[NeuralModels]) -> bool:
    """Whether :class:`KernelTiles` can read a file: explicit profile, no index network, no stand-in for a predictor."""
    model = models.model
    genuine = all(layer.sets.genuine for layer in neural)
    return model.profile == Profile.EXPLICIT and genuine and not any(row.neural for row in model.layers)


def _table(tables: PackedStaticTables, key: StepKey) -> int:
    return ctypes.addressof(tables.step(key).pointer.contents)


def _empty(model: SceneModel, total: int, brief: bool, looked_at: set[int]) -> tuple[TileContent, list[I32]]:
    """Room for a tile, and the planes, (components, total) int32, that its values are views of.

    Args:
        brief: in memory that the thread's next tile takes, and with first values of the channels `looked_at` alone.
    """
    empty = SCRATCH.array if brief else _fresh
    channels = list(enumerate(model.channels))
    planes = [empty(f"plane {k}", (channel.components, total), np.int32) for k, channel in channels]
    columns = [channel.components if k in looked_at or not brief else 0 for k, channel in channels]
    first = [empty(f"first {k}", (total, width), np.int32) for k, width in enumerate(columns)]
    indices = empty("indices", (total, model.max_stages), np.int16)
    codes, classes = empty("codes", (total,), np.uint64), empty("classes", (total,), np.int64)
    slots = np.zeros((total, 0), np.int64)
    return TileContent(codes, classes, [plane.T for plane in planes], first, indices, slots), planes


def _fresh(_name: str, shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    return np.empty(shape, dtype)
