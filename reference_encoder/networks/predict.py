"""Choosing predictors for a scene (SPEC §10.3; encoder side).

The coder itself runs over some tiles with recorders in place of predictors: what they are shown is exactly what a
decoder will know. A network is trained for every step of every component where one may pay, and kept where its contexts
save more bits than the network and its tables cost, and than are transferred while it is computed.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeVar, cast

import numpy as np
from numba import get_num_threads

from reference_encoder.networks.predictor_net import candidates, float_contexts, quantised, train
from reference_encoder.options import EFFORTS, PredictorTraining
from reference_encoder.tuning import (
    MOST_PREDICTED_SHARE,
    PREDICTOR_ANCHORS,
    PREDICTOR_ENTRY_BITS,
    PREDICTOR_LEAST_SYMBOLS,
    PREDICTOR_SAMPLE,
    PREDICTOR_SAMPLE_BYTES,
    PREDICTOR_TABLE_BITS,
    RUN_BITS,
    SKETCH_STRIDE,
    TOP_WEIGHTS,
    WIDER_SHARE,
)
from scarfmt.arrays import F32, F64, I16, I64, Ints
from scarfmt.blocks.predictors import MAX_PREDICTORS, pack_predictors
from scarfmt.coding.decoder_model import DECODER
from scarfmt.coding.tile import NeuralModels, TileContent, put_layer
from scarfmt.container.directory import TileFrame
from scarfmt.container.schema import Profile, Stream
from scarfmt.engines import best_engine
from scarfmt.entropy.emitters import Emitter, SymbolCounter
from scarfmt.entropy.keys import StepKey, TableKey
from scarfmt.errors import Malformed
from scarfmt.neural.predicted import Predictors
from scarfmt.neural.predictors import MAX_CONTEXTS, MAX_INPUTS, Predictor, first_use, input_width
from scarfmt.scene.model import MAX_CLASSES, NO_SOURCE, ContextRule, LayerRow, SceneModel

_T = TypeVar("_T")
Key = tuple[int, int, int]
"""(stream, component, step)."""

_WIDTHS = {4: (4, 0), 8: (8, 3, 0), 16: (16, 8, 3, 0)}
"""Hidden units tried, by the most that an effort allows."""
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
        self._kept = np.flatnonzero(self.random.random(len(x)) < self.share)
        self.inputs.append(x[self._kept].astype(np.int16))
        self.groups.append(len(x))
        return np.zeros(len(x), np.int64)

    def take(self, values: Ints) -> None:
        """The symbols of the inputs just shown."""
        self.symbols.append(values[self._kept])


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


@dataclass(frozen=True)
class Gain:
    """A predictor, and the bits it saves: its own cost and what is transferred while it is computed taken off."""

    predictor: Predictor
    bits: float


def choose_predictors(
    model: SceneModel,
    contents: Sequence[TileContent],
    bits: Sequence[int],
    seed: int = 0,
    effort: int = 2,
    bits_per_ns: float = 0.0,
    repeat: float = 1.0,
) -> dict[int, tuple[Predictor, ...]]:
    """Predictors that pay, by the layer that sends them, keys ascending. Deterministic.

    Args:
        model: of the scene; its context says what predictors look at.
        contents, bits: its tiles, at the last layer, and their local bits per axis.
        effort: 1..3.
        bits_per_ns: what a nanosecond of decoding is worth.
        repeat: how many anchors of the scene each of these stands for.
    """
    model, contents = _predicted_only(model, contents)
    frames, training = [TileFrame(b) for b in bits], EFFORTS[effort].predictors
    whole = {key: round(repeat * total) for key, total in _totals(model, contents).items()}
    promising = {key for key, total in whole.items() if total >= PREDICTOR_LEAST_SYMBOLS}
    seeds = {key: seed + number for number, key in enumerate(sorted(whole))}
    if bits_per_ns:
        few = _some_tiles(frames, contents, seed, PREDICTOR_ANCHORS // SKETCH_STRIDE)
        promising = _promising(model, *few, whole, promising, training, seeds, bits_per_ns)
    if not promising:
        return {}
    frames, contents = _some_tiles(frames, contents, seed, PREDICTOR_ANCHORS)
    static = _static_bits(model, frames, contents, whole, bits_per_ns)

    def best(key: Key, sample: Sample) -> Gain | None:
        return _best(key, sample, static[key], training, seeds[key], bits_per_ns)

    found = _of_samples(best, model, frames, contents, whole, promising, seeds)
    gains = [gain for gain in found if gain is not None]
    return _sent(model, _paying(gains, whole, bits_per_ns))


def _of_samples(
    act: Callable[[Key, Sample], _T],
    model: SceneModel,
    frames: Sequence[TileFrame],
    contents: Sequence[TileContent],
    whole: Mapping[Key, int],
    keys: Collection[Key],
    seeds: Mapping[Key, int],
) -> list[_T]:
    """The result of `act` for each of `keys` and its sample, in any order. Only a few samples are in memory at a
    time."""
    found = list[_T]()
    for batch in _batches(model, whole, keys):
        # Each predictor is trained by itself, so threads change nothing. No name holds samples while others are drawn.
        with ThreadPoolExecutor(get_num_threads()) as pool:
            found += pool.map(lambda item: act(*item), samples(model, frames, contents, whole, batch, seeds).items())
    return found


def _batches(model: SceneModel, whole: Mapping[Key, int], keys: Collection[Key]) -> Iterator[list[Key]]:
    """`keys`, step by step, cut where their samples would take more than `PREDICTOR_SAMPLE_BYTES`."""
    batch, taken = list[Key](), 0
    for stream, component, step in sorted(keys, key=lambda key: (key[0], key[2])):
        channel = model.channel_index(Stream(stream))
        assert channel is not None
        key = stream, component, step
        size = 2 * min(PREDICTOR_SAMPLE, whole[key]) * input_width(model, channel)
        if batch and taken + size > PREDICTOR_SAMPLE_BYTES:
            yield batch
            batch, taken = [], 0
        batch.append(key)
        taken += size
    if batch:
        yield batch


def _sent(model: SceneModel, gains: Sequence[Gain]) -> dict[int, tuple[Predictor, ...]]:
    """Predictors by the layer that sends them: of each layer as many of those that save most as a block may hold."""
    chosen: dict[int, tuple[Predictor, ...]] = {}
    for gain in sorted(gains, key=lambda gain: -gain.bits):
        predictor = gain.predictor
        channel = model.channel_index(predictor.stream)
        layer = None if channel is None else first_use(model, channel, predictor.step)
        assert layer is not None
        chosen[layer] = (*chosen.get(layer, ()), predictor)[:MAX_PREDICTORS]
    return {layer: tuple(sorted(group, key=lambda p: p.key)) for layer, group in sorted(chosen.items())}


def _promising(
    model: SceneModel,
    frames: Sequence[TileFrame],
    contents: Sequence[TileContent],
    whole: Mapping[Key, int],
    keys: Collection[Key],
    training: PredictorTraining,
    seeds: Mapping[Key, int],
    bits_per_ns: float,
) -> set[Key]:
    """The `keys` for which a predictor may pay for its time, judged from a few tiles before any predictor is trained
    well."""
    static = _static_bits(model, frames, contents, whole, bits_per_ns)
    bounds = [(k, _bound(model, k, bits, whole[k], bits_per_ns)) for k, bits in static.items() if k in keys]
    worth = {key for key, _ in _steps_that_pay(bounds, whole, bits_per_ns)}

    def hope(key: Key, sample: Sample) -> tuple[Key, float]:
        return key, _hope(key, sample, static[key], training, seeds[key], bits_per_ns)

    hopes = _of_samples(hope, model, frames, contents, whole, worth, seeds)
    return {key for key, _ in _steps_that_pay(hopes, whole, bits_per_ns)}


def _bound(model: SceneModel, key: Key, bits: float, symbols: int, bits_per_ns: float) -> float:
    """The most that the cheapest predictor, one without hidden units, can save of the static `bits` of a key."""
    channel = model.channel_index(Stream(key[0]))
    assert channel is not None
    least = DECODER.predictor_multiply_add * 2 * input_width(model, channel) * symbols
    return MOST_PREDICTED_SHARE * bits - bits_per_ns * least


def _paying(gains: Sequence[Gain], whole: Mapping[Key, int], bits_per_ns: float) -> list[Gain]:
    """The gains of steps whose predictors together are worth what they share."""
    by_key = {gain.predictor.key: gain for gain in gains}
    return [by_key[key] for key, _ in _steps_that_pay([(k, g.bits) for k, g in by_key.items()], whole, bits_per_ns)]


def _steps_that_pay(
    gains: Sequence[tuple[Key, float]], whole: Mapping[Key, int], bits_per_ns: float
) -> list[tuple[Key, float]]:
    """The (key, bits) above 0 of steps whose components together gain more than their context costs."""
    gains, total = [gain for gain in gains if gain[1] > 0], defaultdict[tuple[int, int], float](float)
    for (stream, _, step), symbols in whole.items():
        total[stream, step] -= bits_per_ns * DECODER.predicted * symbols
    for (stream, _, step), bits in gains:
        total[stream, step] += bits
    return [(key, bits) for key, bits in gains if total[key[0], key[2]] > 0]


def _hope(key: Key, sample: Sample, static: float, training: PredictorTraining, seed: int, bits_per_ns: float) -> float:
    """About the most bits that a predictor of one step of one component can save, from one that is hardly trained."""
    part = Sample(sample.inputs[::SKETCH_STRIDE], sample.symbols[::SKETCH_STRIDE], sample.groups, sample.total)
    sketch = replace(training, units=0, iterations=training.iterations // SKETCH_STRIDE)
    linear = _trained(key, part, static, sketch, seed, bits_per_ns)
    if linear is None:
        return 0.0
    # Each hidden unit looks at all inputs.
    more = _WIDTHS[training.units][-2] * linear.predictor.inputs
    wider = WIDER_SHARE * static - bits_per_ns * DECODER.predictor_multiply_add * more * sample.total
    return linear.bits + max(wider, 0.0)


def _best(
    key: Key, sample: Sample, static: float, training: PredictorTraining, seed: int, bits_per_ns: float
) -> Gain | None:
    """The predictor of one step of one component, None if none pays."""
    widths = (replace(training, units=units) for units in _WIDTHS[training.units])
    found = (_trained(key, sample, static, width, seed, bits_per_ns) for width in widths)
    return max((gain for gain in found if gain and gain.bits > 0), key=lambda gain: gain.bits, default=None)


def _trained(
    key: Key, sample: Sample, static: float, training: PredictorTraining, seed: int, bits_per_ns: float
) -> Gain | None:
    """The best predictor of at most so many hidden units, whether or not it pays; None if readers take none."""
    ternary, stream = key[2] > 1, Stream(key[0])
    net = train(sample.inputs, sample.symbols, ternary, sample.total, training, seed)
    outputs = net.outputs(sample.inputs.astype(np.float64))
    run_bits, product_bits = _run_bits(bits_per_ns), bits_per_ns * DECODER.predictor_multiply_add * sample.total

    def cost(buckets: tuple[int, int]) -> float:
        return expected_bits(float_contexts(outputs, buckets), sample, run_bits)

    buckets = min(candidates(MAX_CONTEXTS), key=cost)
    place, x = (stream, key[1], key[2]), sample.inputs.astype(np.float32)
    best: Gain | None = None
    for top in TOP_WEIGHTS:
        predictor = quantised(net, sample.inputs, outputs, place, buckets, top)
        bits = expected_bits(predictor.contexts(x), sample, run_bits) + 8 * _packed_bytes(predictor)
        saved = static - bits - product_bits * predictor.multiply_adds
        if (best is None or saved > best.bits) and _valid(predictor):
            best = Gain(predictor, saved)
    return best


def _run_bits(bits_per_ns: float) -> float:
    """The worth of opening a table for a run of symbols, bits."""
    return RUN_BITS + bits_per_ns * DECODER.group


def _valid(predictor: Predictor) -> bool:
    """Whether a reader takes it: large biases may leave what binary32 holds exactly."""
    try:
        predictor.check()
    except Malformed:
        return False
    return True


def _packed_bytes(predictor: Predictor) -> int:
    """The bytes that one more predictor adds to a block."""
    return len(pack_predictors([predictor])) - len(pack_predictors([]))


def expected_bits(contexts: I64, sample: Sample, run_bits: float = RUN_BITS) -> float:
    """Bits of the scene's symbols under (m,) `contexts` of the sample's, with tables and `run_bits` for each run."""
    width = int(sample.ranks.max()) + 1
    counts = np.bincount(contexts * width + sample.ranks, minlength=width * (int(contexts.max()) + 1))
    counts = counts.reshape(-1, width)
    shares = counts.sum(axis=1) / len(contexts)
    # Groups whose symbols are few do not meet every context.
    met = 1 - np.power(1 - shares[:, None], sample.groups)
    runs = float(met.sum()) * sample.total / float(sample.groups.sum())
    return coded_bits(list(counts), sample.total) + run_bits * runs


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
            put_layer(model, layer, frame, content, lambda _: emitter, neural, best_engine())


class RunCounter(SymbolCounter):
    """Counts symbols, and the runs that share a table."""

    def __init__(self) -> None:
        super().__init__()
        self.runs: Counter[Key] = Counter()

    def emit_grouped(self, key: StepKey, kinds: Ints, values: Ints) -> None:
        super().emit_grouped(key, kinds, values)
        self.runs.update(key.table(int(kind))[:3] for kind in np.unique(kinds))


def _static_bits(
    model: SceneModel,
    frames: Sequence[TileFrame],
    contents: Sequence[TileContent],
    whole: Mapping[Key, int],
    bits_per_ns: float,
) -> dict[Key, float]:
    """Bits of every step of every component under the static contexts, with tables and what opening them is worth."""
    counter = RunCounter()
    _run(model, frames, contents, counter, NeuralModels())
    histograms: dict[Key, list[I64]] = {}
    for key, (_, counts) in counter.histograms().items():
        histograms.setdefault(key[:3], []).append(counts)
    here = _totals(model, contents)
    return {
        key: coded_bits(found, whole[key])
        + bits_per_ns * DECODER.group * counter.runs[key] * whole[key] / max(here[key], 1)
        for key, found in histograms.items()
        if key in whole
    }


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
    frames: Sequence[TileFrame], contents: Sequence[TileContent], seed: int, anchors: int
) -> tuple[list[TileFrame], list[TileContent]]:
    """Tiles drawn at random until they have so many anchors."""
    order = np.random.default_rng(seed).permutation(len(contents))
    before = np.cumsum([0, *(len(contents[tile]) for tile in order)])[:-1]
    kept = sorted(int(tile) for tile in order[before < anchors])
    return [frames[tile] for tile in kept], [contents[tile] for tile in kept]


def _predicted_only(model: SceneModel, contents: Sequence[TileContent]) -> tuple[SceneModel, list[TileContent]]:
    """The scene with nothing but positions, classes and channels that may have predictors: the rest is of no use."""
    kept = tuple(index for index in model.predicted if input_width(model, index) <= MAX_INPUTS)

    def moved(rule: ContextRule) -> ContextRule:
        # Sources are coded earlier, and position residuals are never one: all are kept.
        found = rule.source_channel
        return rule if found == NO_SOURCE else replace(rule, source_channel=kept.index(found))

    channels = tuple(
        replace(channel, rules=tuple(moved(rule) for rule in channel.rules))
        for channel in (model.channels[index] for index in kept)
    )
    rows = tuple(
        LayerRow((0,) * row.class_count, tuple(tuple(steps[index] for index in kept) for steps in row.steps))
        for row in model.layers
    )
    parts = [
        replace(
            content,
            values=[content.values[index] for index in kept],
            first=[content.first[index] for index in kept],
            indices=content.indices[:, :0],
            slot_layers=content.slot_layers[:, :0],
        )
        for content in contents
    ]
    return SceneModel(Profile.EXPLICIT, 1, channels, rows, model.context), parts
