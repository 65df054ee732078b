"""One tile: what it holds after a layer, and the order in which a layer's symbols travel (SPEC §7).

Anchors of a tile are ordered by the layer in which they appear, then by Morton code; anchors of equal code
keep the encoder's order. Codecs see all of them and pick those a layer concerns.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import I16, I32, I64, U64, Ints
from scarfmt.codecs.channels import check_reach, coarsen, get_channel, put_channel, steps_between
from scarfmt.codecs.classes import get_classes, put_classes
from scarfmt.codecs.indices import get_indices, put_indices
from scarfmt.codecs.masks import get_masks, get_offsets, put_masks, put_offsets
from scarfmt.codecs.neural_indices import get_neural_indices, put_neural_indices
from scarfmt.codecs.positions import get_positions, put_positions
from scarfmt.container.directory import TileFrame
from scarfmt.container.schema import Profile, Stream
from scarfmt.entropy.emitters import Emitter
from scarfmt.entropy.symbol_reader import SymbolReader
from scarfmt.neural.evaluator import Evaluator
from scarfmt.neural.layer_context import LayerContext
from scarfmt.neural.predicted import PredictedChannel, Predictors
from scarfmt.observe import LayerObserver
from scarfmt.scene.model import SceneModel
from scarfmt.scene.streams import OF_NEW_ANCHORS, STREAMS

OpenStream = Callable[[Stream], SymbolReader]


@dataclass(frozen=True)
class NeuralModels:
    """The models that code symbols beside static tables (SPEC §10).

    Attributes:
        predictors: in force, by key.
        indices: what codes indices in layers of entropy mode 1; None where no such layer is.
    """

    predictors: Predictors = field(default_factory=dict)
    indices: Evaluator | None = None

    def coder(self, model: SceneModel, layer: int) -> Evaluator | None:
        """The coder of the indices of a layer; None for static tables."""
        return self.indices if model.layers[layer - 1].neural else None


STATIC = NeuralModels()


@dataclass
class TileContent:
    """Exact content of one tile, at one layer (decoder) or the last (encoder).

    Attributes:
        codes: (n,) uint64 local Morton codes.
        classes: (n,) int64.
        values: per channel (n, components) int32, v after the steps the layer table gives; offsets (n, K, 3).
        indices: (n, stages) int16 codeword numbers, 0 where none was received.
        slot_layers: (n, K) int64 layer that turned the slot on, 0 = off; K = 0 in the explicit profile.
    """

    codes: U64
    classes: I64
    values: list[I32]
    indices: I16
    slot_layers: I64

    def __len__(self) -> int:
        return len(self.codes)

    @classmethod
    def empty(cls, model: SceneModel, count: int = 0) -> TileContent:
        """`count` anchors of class 0 with nothing received."""
        slots = model.slots if model.profile == Profile.ANCHOR else 0
        values = [
            np.zeros((count, slots, c.components) if c.per_slot else (count, c.components), np.int32)
            for c in model.channels
        ]
        return cls(
            np.zeros(count, np.uint64),
            np.zeros(count, np.int64),
            values,
            np.zeros((count, model.max_stages), np.int16),
            np.zeros((count, slots), np.int64),
        )

    def head(self, count: int) -> TileContent:
        """The first `count` anchors, as views: what is written there is written here."""
        return TileContent(
            self.codes[:count],
            self.classes[:count],
            [values[:count] for values in self.values],
            self.indices[:count],
            self.slot_layers[:count],
        )


def put_layer(
    model: SceneModel,
    layer: int,
    frame: TileFrame,
    content: TileContent,
    emitters: Callable[[Stream], Emitter],
    neural: NeuralModels = STATIC,
) -> int:
    """Emit one layer of one tile.

    Args:
        layer: 1-based.
        frame: local coordinates of the tile.
        content: the tile at the model's last layer, anchors in order.
        emitters: gives the emitter of a stream kind.

    Returns:
        How many anchors first appear in it.
    """
    known, past = model.first_new_class(layer), model.layers[layer - 1].class_count
    # Anchors are ordered by the layer in which they appear: those known are the first ones.
    content = content.head(int((content.classes < past).sum()))
    classes = content.classes
    new = np.flatnonzero(classes >= known)
    put_positions(emitters(Stream.POSITIONS), content.codes[new], frame.bits)
    put_classes(emitters(Stream.CLASSES), classes[new], known, past)
    if model.profile == Profile.ANCHOR:
        slot_layers = content.slot_layers
        before, after = (slot_layers > 0) & (slot_layers < layer), (slot_layers > 0) & (slot_layers <= layer)
        put_masks(emitters(Stream.MASKS), before, after)
    last = len(model.layers)
    coder = neural.coder(model, layer)
    context = _context(model, frame, content, neural.predictors, coder)
    for index, channel in enumerate(model.channels):
        emitter = emitters(channel.stream)
        if channel.per_slot:
            put_offsets(emitter, channel, content.values[index], after & ~before)
            continue
        before_steps, after_steps = model.steps(layer - 1, index, classes), model.steps(layer, index, classes)
        final = (content.values[index], model.steps(last, index, classes))
        predicted = None
        if context is not None:
            steps = before_steps, after_steps
            predicted = _predict(context, index, neural.predictors, _at(*final, before_steps), steps)
        put_channel(emitter, channel, before_steps, after_steps, final, predicted)
        if context is not None and index in model.attributes:
            context.settle(index, _at(*final, after_steps), after_steps)
    stages = model.stages(layer - 1, classes), model.stages(layer, classes)
    if coder is not None and context is not None:
        put_neural_indices(emitters(Stream.INDICES), coder, context, content.indices, *stages)
    else:
        put_indices(emitters(Stream.INDICES), content.indices, classes, *stages)
    return len(new)


def _at(values: I32, at: I64, steps: I64) -> I64:
    """(n, components) `values`, which are at (n,) `at` steps, at `steps` steps; 0 at none."""
    return np.where(steps[:, None] > 0, coarsen(values, (at - steps)[:, None]), 0)


def _context(
    model: SceneModel,
    frame: TileFrame,
    content: TileContent,
    predictors: Predictors,
    coder: Evaluator | None,
    observer: LayerObserver | None = None,
) -> LayerContext | None:
    """The decoded context of a tile-layer, None where nothing looks at it."""
    if coder is None and not predictors:
        return None
    return LayerContext(model, frame, content.codes, content.classes, observer)


def _predict(
    context: LayerContext, index: int, predictors: Predictors, values: Ints, steps: tuple[I64, I64]
) -> PredictedChannel | None:
    """The predictors of a channel's steps in a layer, None where none of those that travel has any."""
    channel = PredictedChannel(context, index, predictors, values, steps[0])
    return channel if any(map(channel.covers, steps_between(*steps))) else None


def find_needed(model: SceneModel, wanted: Collection[Stream], neural: NeuralModels = STATIC) -> frozenset[Stream]:
    """The channels that must be decoded for the streams wanted: those themselves, and contexts of those that are."""
    need = [channel.stream in wanted for channel in model.channels]
    predicted = {stream for stream, _, _ in neural.predictors}
    if neural.indices is not None and Stream.INDICES in wanted:
        for index in model.attributes:
            need[index] = True
    for index in range(len(need) - 1, -1, -1):
        if need[index] and model.channels[index].stream in predicted:
            for source in model.attributes:
                need[source] |= source < index
    return frozenset(channel.stream for channel, needed in zip(model.channels, need, strict=True) if needed)


def list_coded(model: SceneModel, new: int) -> set[Stream]:
    """Sub-streams that may have bytes in a TILE block in which `new` anchors appear (SPEC §7.1)."""
    others = (
        spec.stream
        for spec in STREAMS.values()
        if not spec.is_channel and model.profile in spec.profiles and (new or spec.codec not in OF_NEW_ANCHORS)
    )
    return {*others, *(channel.stream for channel in model.channels)}


def get_layer(
    model: SceneModel,
    layer: int,
    frame: TileFrame,
    content: TileContent,
    new: int,
    open_stream: OpenStream,
    wanted: Collection[Stream],
    book_sizes: tuple[int, int],
    neural: NeuralModels = STATIC,
    observer: LayerObserver | None = None,
) -> None:
    """Read one layer of one tile, in place: the inverse of :func:`put_layer`.

    Args:
        content: the tile after the layer before, and room for `new` anchors at its end.
        new: anchors that first appear in this layer.
        open_stream: gives the reader of a stream kind.
        wanted: channel streams to decode (positions, classes and masks always are); others stay 0.
        book_sizes: codewords in the coarse and the residual codebook.
    """
    if new:
        _get_new(model, layer, frame, content, new, open_stream)
    classes, turned_on = content.classes, _turn_on(layer, content, open_stream)
    need = find_needed(model, wanted, neural)
    coder = neural.coder(model, layer) if Stream.INDICES in wanted else None
    context = _context(model, frame, content, neural.predictors, coder, observer)
    for index, channel in enumerate(model.channels):
        if channel.stream not in need:
            continue
        with _open(open_stream, channel.stream) as reader:
            if channel.per_slot:
                get_offsets(reader, channel, content.values[index], turned_on)
                continue
            steps = model.steps(layer - 1, index, classes), model.steps(layer, index, classes)
            values = content.values[index]
            predicted = None
            if context is not None:
                predicted = _predict(context, index, neural.predictors, values, steps)
            get_channel(reader, channel, *steps, values, predicted)
        if context is not None and index in model.attributes:
            context.settle(index, content.values[index], steps[1])
        # What this layer leaves as it was has been checked.
        if channel.stream == Stream.POSITION_RESIDUAL and not np.array_equal(*steps):
            check_reach(content.values[index], channel.first_width, steps[1])
    if Stream.INDICES in wanted:
        with _open(open_stream, Stream.INDICES) as reader:
            stages = model.stages(layer - 1, classes), model.stages(layer, classes)
            if coder is not None and context is not None:
                get_neural_indices(reader, coder, context, content.indices, *stages)
                return
            get_indices(reader, content.indices, classes, *stages, book_sizes)


def _get_new(
    model: SceneModel,
    layer: int,
    frame: TileFrame,
    content: TileContent,
    new: int,
    open_stream: OpenStream,
) -> None:
    """Positions and classes of the last `new` anchors."""
    with _open(open_stream, Stream.POSITIONS) as reader:
        content.codes[-new:] = get_positions(reader, new, frame.bits)
    with _open(open_stream, Stream.CLASSES) as reader:
        known, past = model.first_new_class(layer), model.layers[layer - 1].class_count
        content.classes[-new:] = get_classes(reader, new, known, past)


def _turn_on(layer: int, content: TileContent, open_stream: OpenStream) -> NDArray[np.bool_]:
    """(n, K) bool: Gaussian slots that this layer turns on, noted in `content`."""
    before = content.slot_layers > 0
    with _open(open_stream, Stream.MASKS) as reader:
        turned_on = get_masks(reader, before) & ~before
    content.slot_layers[turned_on] = layer
    return np.asarray(turned_on)


@contextmanager
def _open(open_stream: OpenStream, stream: Stream) -> Iterator[SymbolReader]:
    """The reader of a stream, whose seal is checked when all was read."""
    reader = open_stream(stream)
    yield reader
    reader.finish()
