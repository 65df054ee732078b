"""Choosing predictors for a scene (SPEC §10.3; encoder side).

The coder itself runs over some tiles with recorders in place of predictors: what they are shown is exactly what a
decoder will know. A network is trained for every step of every component where one may pay, and kept where its contexts
save more bits than the network and its tables cost.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import cast

import numpy as np

from reference_encoder.training.networks.predictor_training import BUCKETS, float_contexts, quantise, train
from reference_encoder.training.options import Stop, never
from reference_encoder.tuning import (
    PREDICTOR_ANCHORS,
    PREDICTOR_ENTRY_BITS,
    PREDICTOR_LEAST_SYMBOLS,
    PREDICTOR_SAMPLE,
    PREDICTOR_SAMPLE_BYTES,
    PREDICTOR_TABLE_BITS,
    PREDICTOR_UNITS,
    RUN_BITS,
    TOP_WEIGHTS,
)
from scarfmt.arrays import F32, F64, I16, I64, Ints
from scarfmt.blocks.predictors import MAX_PREDICTORS, pack_predictors
from scarfmt.coding.reader import batches
from scarfmt.coding.tile import NeuralModels, TileContent, put_layer
from scarfmt.container.directory import TileFrame
from scarfmt.container.schema import Profile, Stream
from scarfmt.entropy.emitters import Emitter, SymbolCounter
from scarfmt.entropy.keys import TableKey
from scarfmt.errors import Malformed
from scarfmt.neural.predicted import Predictors
from scarfmt.neural.predictors import MAX_INPUTS, Predictor, first_use, input_width
from scarfmt.scene.model import MAX_CLASSES, LayerRow, SceneModel
from scarfmt.threads import count_threads

Key = tuple[int, int, int]
"""(stream, component, step)."""

_ESTIMATE = 0.5 / np.log(2)
"""Bits by which the entropy of a histogram falls short of the truth, per free entry (Miller and Madow)."""


@dataclass
class Recorder:
    """Stands in for a predictor, and keeps a share of what it is shown.

    Attributes:
        share: of the symbols to keep.
        random: chooses them.
        inputs, symbols: (m, inputs) and (m,) kept so far.
        groups: symbols of each group seen.
    """

    share: float
    random: np.random.Generator
    inputs: list[I16] = field(default_factory=list)
    symbols: list[Ints] = field(default_factory=list)
    groups: list[int] = field(default_factory=list)

    def contexts(self, x: F32) -> I64:
        """Context 0 for everything."""
        self._chosen = np.flatnonzero(self.random.random(len(x)) < self.share)
        self.inputs.append(x[self._chosen].astype(np.int16))
        self.groups.append(len(x))
        return np.zeros(len(x), np.int64)

    def take(self, values: Ints) -> None:
        """The symbols of the inputs just shown."""
        self.symbols.append(values[self._chosen])


class _Tap(Emitter):
    """An emitter that hands recorders their symbols."""

    def __init__(self, recorders: Mapping[Key, Recorder]) -> None:
        self._recorders = recorders

    def emit(self, key: TableKey, values: Ints) -> None:
        recorder = self._recorders.get(key[:3])
        if recorder is not None:
            recorder.take(values)

    def emit_uniform(self, size: int, values: Ints) -> None:
        """Nothing: no channel is coded so."""

    def emit_rows(self, weights: F64, values: Ints) -> None:
        """Nothing: no channel is coded so."""


@dataclass(frozen=True)
class Sample:
    """The data about one step of one component that a predictor is trained on.

    Attributes:
        inputs: (m, inputs) int16 and symbols (m,) of a random sample.
        groups: symbols of each group of the tiles looked at.
        total: symbols of the whole scene.
    """

    inputs: I16
    symbols: I64
    groups: I64
    total: int

    @cached_property
    def ranks(self) -> I64:
        """(m,) each symbol's place among those that occur: outliers make no wide histograms."""
        return np.unique(self.symbols, return_inverse=True)[1].astype(np.int64)


Gain = tuple[float, Predictor]
"""The bits that a predictor saves, its own cost taken off, and the predictor."""


def choose_predictors(
    model: SceneModel, contents: Sequence[TileContent], bits: Sequence[int], stop: Stop = never
) -> dict[int, tuple[Predictor, ...]]:
    """Predictors that pay, by the layer that sends them, keys ascending. Deterministic.

    Args:
        model: of the scene; its context says what predictors look at.
        contents, bits: its tiles, at the last layer, and their local bits per axis.
        stop: asked before each whether to leave out those that are left, which would save least.
    """
    model, contents = _keep_predicted(model, contents)
    whole = _totals(model, contents)
    promising = [key for key, total in whole.items() if total >= PREDICTOR_LEAST_SYMBOLS]
    seeds = {key: number for number, key in enumerate(sorted(whole))}
    if not promising:
        return {}
    frames, contents = _some_tiles([TileFrame(b) for b in bits], contents)
    static = _static_bits(model, frames, contents, whole)

    def best(item: tuple[Key, Sample]) -> Gain | None:
        key, sample = item
        return None if stop() else _best(key, sample, static[key], seeds[key])

    gains: list[Gain | None] = []
    promising = sorted(promising, key=lambda key: (-static.get(key, 0.0), key))
    for batch in batches(promising, lambda key: _sample_bytes(model, key, whole[key]), PREDICTOR_SAMPLE_BYTES):
        if stop():
            break
        # Each predictor is trained by itself, so threads change nothing. No name holds samples while others are drawn.
        with ThreadPoolExecutor(count_threads()) as pool:
            gains += pool.map(best, samples(model, frames, contents, whole, batch, seeds).items())
    return _choose_sent(model, [gain for gain in gains if gain is not None])


def _sample_bytes(model: SceneModel, key: Key, total: int) -> int:
    channel = model.channel_index(Stream(key[0]))
    assert channel is not None
    return 2 * min(PREDICTOR_SAMPLE, total) * input_width(model, channel)


def _choose_sent(model: SceneModel, gains: Sequence[Gain]) -> dict[int, tuple[Predictor, ...]]:
    """Predictors by the layer that sends them: of each layer as many of those that save most as a block may hold."""
    chosen: dict[int, tuple[Predictor, ...]] = {}
    for _, predictor in sorted(gains, key=lambda gain: -gain[0]):
        channel = model.channel_index(predictor.stream)
        layer = None if channel is None else first_use(model, channel, predictor.step)
        assert layer is not None
        chosen[layer] = (*chosen.get(layer, ()), predictor)[:MAX_PREDICTORS]
    return {layer: tuple(sorted(group, key=lambda p: p.key)) for layer, group in sorted(chosen.items())}


def _best(key: Key, sample: Sample, static: float, seed: int) -> Gain | None:
    """The predictor of one step of one component, None if none pays."""
    gains = (_train_best(key, sample, static, units, seed) for units in PREDICTOR_UNITS)
    return max((gain for gain in gains if gain and gain[0] > 0), key=lambda gain: gain[0], default=None)


def _train_best(key: Key, sample: Sample, static: float, units: int, seed: int) -> Gain | None:
    """The best predictor of at most so many hidden units, whether or not it pays; None if readers take none."""
    ternary, stream = key[2] > 1, Stream(key[0])
    net = train(sample.inputs, sample.symbols, ternary, sample.total, units, seed)
    outputs = net.outputs(sample.inputs.astype(np.float64))
    buckets = min(BUCKETS, key=lambda tried: expected_bits(float_contexts(outputs, tried), sample))
    place, x = (stream, key[1], key[2]), sample.inputs.astype(np.float32)
    best: Gain | None = None
    for top in TOP_WEIGHTS:
        predictor = quantise(net, sample.inputs, outputs, place, buckets, top)
        packed = len(pack_predictors([predictor])) - len(pack_predictors([]))
        saved = static - (expected_bits(predictor.contexts(x), sample) + 8 * packed)
        if (best is None or saved > best[0]) and _valid(predictor):
            best = saved, predictor
    return best


def _valid(predictor: Predictor) -> bool:
    """Whether a reader takes it: large biases may leave what binary32 holds exactly."""
    try:
        predictor.check()
    except Malformed:
        return False
    return True


def expected_bits(contexts: I64, sample: Sample) -> float:
    """Bits of the scene's symbols under (m,) `contexts` of the sample's, with tables and `RUN_BITS` for each run."""
    width = int(sample.ranks.max()) + 1
    counts = np.bincount(contexts * width + sample.ranks, minlength=width * (int(contexts.max()) + 1))
    counts = counts.reshape(-1, width)
    shares = counts.sum(axis=1) / len(contexts)
    # Groups whose symbols are few do not meet every context.
    met = 1 - np.power(1 - shares[:, None], sample.groups)
    runs = float(met.sum()) * sample.total / float(sample.groups.sum())
    return coded_bits(list(counts), sample.total) + RUN_BITS * runs


def coded_bits(histograms: Sequence[I64], total: int) -> float:
    """Bits of `total` symbols, of which these are sample histograms by context, and of their tables."""
    bits = tables = 0.0
    count = 0
    for histogram in histograms:
        used = histogram[histogram > 0].astype(np.float64)
        if len(used):
            bits += float((used * np.log2(used.sum() / used)).sum()) + _ESTIMATE * (len(used) - 1)
            tables += PREDICTOR_TABLE_BITS + PREDICTOR_ENTRY_BITS * len(used)
            count += int(used.sum())
    return bits / max(count, 1) * total + tables


def samples(
    model: SceneModel,
    frames: Sequence[TileFrame],
    contents: Sequence[TileContent],
    whole: Mapping[Key, int],
    keys: Collection[Key],
    seeds: Mapping[Key, int],
) -> dict[Key, Sample]:
    """A sample of the symbols of those `keys` that have any here, drawn with the seed of each."""
    here = _totals(model, contents)
    recorders = {
        key: Recorder(min(1.0, PREDICTOR_SAMPLE / here[key]), np.random.default_rng(seeds[key]))
        for key in keys
        if here[key]
    }
    _run(model, frames, contents, _Tap(recorders), NeuralModels(cast(Predictors, recorders)))
    out = {}
    for key in list(recorders):
        recorder = recorders.pop(key)
        symbols = np.concatenate(recorder.symbols).astype(np.int64)
        groups = np.array(recorder.groups)
        out[key] = Sample(np.concatenate(recorder.inputs), symbols, groups[groups > 0], whole[key])
    return out


def _run(
    model: SceneModel,
    frames: Sequence[TileFrame],
    contents: Sequence[TileContent],
    emitter: Emitter,
    neural: NeuralModels,
) -> None:
    for layer in range(1, len(model.layers) + 1):
        for frame, content in zip(frames, contents, strict=True):
            put_layer(model, layer, frame, content, lambda _: emitter, neural)


def _static_bits(
    model: SceneModel, frames: Sequence[TileFrame], contents: Sequence[TileContent], whole: Mapping[Key, int]
) -> dict[Key, float]:
    """Bits of every step of every component under the static contexts, with tables."""
    counter = SymbolCounter()
    _run(model, frames, contents, counter, NeuralModels())
    histograms: dict[Key, list[I64]] = {}
    for key, (_, counts) in counter.histograms().items():
        histograms.setdefault(key[:3], []).append(counts)
    return {key: coded_bits(counts, whole[key]) for key, counts in histograms.items() if key in whole}


def _totals(model: SceneModel, contents: Sequence[TileContent]) -> dict[Key, int]:
    """Symbols of every step of every component: each anchor has each step once."""
    classes = sum((np.bincount(c.classes, minlength=MAX_CLASSES) for c in contents), np.zeros(MAX_CLASSES, np.int64))
    out = {}
    for index, channel in enumerate(model.channels):
        steps = np.array([row[index] for row in model.layers[-1].steps])
        for step in range(1, int(steps.max()) + 1):
            total = int(classes[: len(steps)][steps >= step].sum())
            out.update({(int(channel.stream), c, step): total for c in range(channel.components)})
    return out


def _some_tiles(
    frames: Sequence[TileFrame], contents: Sequence[TileContent]
) -> tuple[list[TileFrame], list[TileContent]]:
    """Tiles drawn at random until they have `PREDICTOR_ANCHORS`."""
    order = np.random.default_rng(0).permutation(len(contents))
    before = np.cumsum([0, *(len(contents[tile]) for tile in order)])[:-1]
    chosen = sorted(int(tile) for tile in order[before < PREDICTOR_ANCHORS])
    return [frames[tile] for tile in chosen], [contents[tile] for tile in chosen]


def _keep_predicted(model: SceneModel, contents: Sequence[TileContent]) -> tuple[SceneModel, list[TileContent]]:
    """The scene with nothing but positions, classes and channels that may have predictors: the rest is of no use."""
    chosen = tuple(index for index in model.predicted if input_width(model, index) <= MAX_INPUTS)
    channels = tuple(model.channels[index] for index in chosen)
    rows = tuple(
        LayerRow((0,) * row.class_count, tuple(tuple(steps[index] for index in chosen) for steps in row.steps))
        for row in model.layers
    )
    parts = [
        replace(
            content,
            values=[content.values[index] for index in chosen],
            indices=content.indices[:, :0],
            slot_layers=content.slot_layers[:, :0],
        )
        for content in contents
    ]
    return SceneModel(Profile.EXPLICIT, 1, channels, rows, model.context), parts
