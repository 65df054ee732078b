"""A channel's steps in one tile-layer, by the compiled library (SPEC §7.5, §10.3)."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from scarfmt.arrays import I32, I64, Ints
from scarfmt.codecs.channels import bad_trit, steps_between, value_range
from scarfmt.container.schema import Stream
from scarfmt.entropy.emitters import Emitter
from scarfmt.entropy.keys import StepKey
from scarfmt.entropy.symbol_tables import missing_table
from scarfmt.kernel.cells import cell_names
from scarfmt.kernel.channel import BAD_TRIT, VALUE_RANGE, KernelChannel
from scarfmt.kernel.packed_predictors import PackedPredictorSet, PackedPredictorSteps, Surroundings
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
    """The engine's version of :func:`scarfmt.codecs.channels.put_channel`, which calls the library once.

    Args:
        steps: before and after.
        predicted: the channel's predictors, none a stand-in; or None.

    Raises:
        InvalidInput: ``input-symbol``: a value leaves 32 bits.
    """
    before, after = steps
    if np.array_equal(before, after):
        return
    coded = steps_between(before, after)
    sources = [np.ascontiguousarray(array, np.int32) for array in first]
    known, at = np.empty(final[0].shape, np.int32), np.empty(len(classes), np.int64)
    target = KernelChannel(library, channel, classes, known, sources, at)
    around, predictors = _looked_at(library, channel, coded, predicted)
    groups, kinds, symbols = target.write(coded, steps, final, around, predictors)
    named = {step: _step_key(channel.stream, channel.components, step) for step in coded}
    emitter.emit_groups([(named[step], size) for step, size in groups], kinds, symbols)


def _looked_at(
    library: ctypes.CDLL, channel: Channel, coded: range, predicted: PredictedChannel | None
) -> tuple[Surroundings | None, PackedPredictorSteps | None]:
    """The surroundings that predictors of some steps read, and the predictors; None if there are none."""
    if predicted is None:
        return None, None
    around = _surroundings(library, predicted)
    packed = predicted.predictors.kept(PackedPredictorSet)
    return around, packed.steps(channel.stream, coded, channel.components, around.cells.depths)


@lru_cache(maxsize=1024)
def _step_key(stream: Stream, components: int, step: int) -> StepKey:
    return StepKey(stream, tuple(range(components)), step)


def get_channel(
    reader: KernelSymbolReader,
    channel: Channel,
    classes: I64,
    steps: tuple[I64, I64],
    values: I32,
    first: Sequence[I32],
    predicted: PredictedChannel | None,
) -> None:
    """The engine's version of :func:`scarfmt.codecs.channels.get_channel`, which calls the library once.

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
    around, predictors = _looked_at(reader.rans.functions, channel, coded, predicted)
    found, at_step, received = target.read(reader.rans, coded, steps, tables, around, predictors)
    if found == BAD_TRIT:
        raise bad_trit()
    if found == VALUE_RANGE:
        raise value_range(channel)
    if found != ALL_READ:
        raise missing_table(_step_key(channel.stream, channel.components, at_step).table(found))
    reader.static += sum(received) * channel.components
    if predicted is not None:
        predicted.count(coded, received)
