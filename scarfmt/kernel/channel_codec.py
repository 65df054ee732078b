"""A channel's steps in one tile-layer, by the compiled library (SPEC §7.5, §10.3)."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence

import numpy as np

from scarfmt.arrays import I32, I64, Ints
from scarfmt.codecs.channels import bad_trit, coarsen, steps_between, steps_coded, value_range
from scarfmt.entropy.emitters import Emitter
from scarfmt.entropy.keys import StepKey
from scarfmt.entropy.symbol_tables import missing_table
from scarfmt.kernel.cells import cell_names
from scarfmt.kernel.channel import BAD_TRIT, VALUE_RANGE, KernelChannel
from scarfmt.kernel.packed_predictors import PackedPredictorSet, Surroundings
from scarfmt.kernel.stream_decoder import ALL_READ
from scarfmt.kernel.symbols import KernelSymbolReader
from scarfmt.neural.predicted import PredictedChannel
from scarfmt.scene.model import Channel


def _surroundings(library: ctypes.CDLL, predicted: PredictedChannel) -> Surroundings:
    context = predicted.context
    names, log2 = context.kept(cell_names, library), context.model.context.passes_log2
    return Surroundings(predicted.settled, names, context.by_code, log2)


def put_channel(
    library: ctypes.CDLL,
    emitter: Emitter,
    channel: Channel,
    classes: I64,
    steps: tuple[I64, I64],
    final: tuple[Ints, I64],
    first: Sequence[I32],
    predicted: PredictedChannel | None,
) -> None:
    """What :func:`scarfmt.codecs.channels.put_channel` emits: a call of the library for each step.

    Args:
        steps: before and after.
        predicted: the channel's predictors, none a stand-in; or None.
    """
    (before, after), (values, at) = steps, final
    known = np.where(before[:, None] > 0, coarsen(values, (at - before)[:, None]), 0).astype(np.int32)
    sources = [np.ascontiguousarray(array, np.int32) for array in first]
    target = KernelChannel(library, channel, classes, known, sources, before.astype(np.int64))
    for step in steps_coded(before, after):
        chosen = np.flatnonzero((before < step) & (after >= step))
        if not len(chosen):
            continue
        given = np.zeros(values.shape, np.int32)
        given[chosen] = coarsen(values[chosen], (at[chosen] - step)[:, None])
        parts, around, predictors = [chosen], None, None
        if predicted is not None and predicted.covers(step):
            parts, around = predicted.passes(chosen), _surroundings(library, predicted)
            packed = predicted.predictors.kept(PackedPredictorSet)
            predictors = packed.step(channel.stream, step, channel.components, around.cells.depths)
        key = StepKey(channel.stream, tuple(range(channel.components)), step)
        for kinds, symbols in target.write(step, parts, given, around, predictors):
            emitter.emit_grouped(key, kinds, symbols)


def get_channel(
    reader: KernelSymbolReader,
    channel: Channel,
    classes: I64,
    steps: tuple[I64, I64],
    values: I32,
    first: Sequence[I32],
    predicted: PredictedChannel | None,
) -> None:
    """What :func:`scarfmt.codecs.channels.get_channel` reads: one call of the library.

    Args:
        steps, predicted: as of :func:`put_channel`.

    Raises:
        Malformed: ``bad-trit``, ``value-range``, ``missing-table``.
    """
    before, after = steps
    if np.array_equal(before, after):
        return
    coded = steps_between(before, after)
    at = np.empty(len(classes), np.int64)
    target = KernelChannel(reader.rans.functions, channel, classes, values, first, at)
    tables = reader.packed.steps(channel.stream, channel.components, coded)
    around = predictors = None
    if predicted is not None:
        around = _surroundings(reader.rans.functions, predicted)
        packed = predicted.predictors.kept(PackedPredictorSet)
        predictors = packed.steps(channel.stream, coded, channel.components, around.cells.depths)
    found, at_step, received = target.read(reader.rans, coded, steps, tables, around, predictors)
    if found == BAD_TRIT:
        raise bad_trit()
    if found == VALUE_RANGE:
        raise value_range(channel)
    if found != ALL_READ:
        raise missing_table(StepKey(channel.stream, tuple(range(channel.components)), at_step).table(found))
    reader.static += sum(received) * channel.components
    if predicted is not None:
        predicted.count(coded, received)
