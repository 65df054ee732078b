"""Channel sub-streams: a first value, then exact ternary refinements (SPEC §7.5; the paper's trits).

With n steps received the quantised value is v_n, an integer; v_n = 3 v_(n-1) + t with t in {-1, 0, 1}, and
the attribute is v_n * step / 3^(n-1). Cells nest, so any prefix of steps is itself a rounding to nearest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np

from scarfmt.arrays import F32, F64, I32, I64, Ints
from scarfmt.container.schema import Stream
from scarfmt.entropy.emitters import Emitter
from scarfmt.entropy.keys import CONTEXTS, StepKey, TableKey
from scarfmt.entropy.symbol_reader import SymbolReader
from scarfmt.errors import Malformed
from scarfmt.native.binding import library
from scarfmt.neural.predicted import PredictedChannel
from scarfmt.scene.model import MAX_STEPS, Channel

REACH = 1.0
"""Largest magnitude of a position residual, in cells of 2^shift voxels: it bounds where a tile's anchors can be."""

_POWERS = 3 ** np.arange(MAX_STEPS + 1, dtype=np.int64)
VALUE_LIMIT = (1 << 31) - 1
"""Largest magnitude of a channel value: -2^31 is left out, so that every value can be negated."""
# (anchors, step, components, contexts, values before) -> values after; one row a component.
Exchange = Callable[[I64, int, Sequence[int], Sequence[I64], I64], I64]


def coarsen(values: Ints, steps: I64 | int) -> I64:
    """Drop `steps` ternary digits of `values`, rounding to nearest: v_n -> v_(n - steps) (SPEC §7.5)."""
    power = _POWERS[np.asarray(steps, np.int64)]
    return np.asarray((np.asarray(values, np.int64) + (power - 1) // 2) // power)


def trit_contexts(values: Ints) -> I64:
    """int64 context numbers of a ternary step, of the shape of `values`: the value refined, clamped to -2..2, + 2."""
    return np.clip(values, -2, 2).astype(np.int64) + 2


def put_channel(
    emitter: Emitter,
    channel: Channel,
    before: I64,
    after: I64,
    final: tuple[Ints, I64],
    predicted: PredictedChannel | None = None,
) -> None:
    """Emit the steps before+1..after of every anchor of a tile.

    Args:
        before, after: (n,) steps of each anchor before and after this layer.
        final: (n, components) values and (n,) the step counts they are at, each >= `after`.
        predicted: the channel's predictors, if it has any.
    """
    values, at = final

    def put(part: I64, step: int, components: Sequence[int], kinds: Sequence[I64], coarse: I64) -> I64:
        here = coarsen(values[part[:, None], components].T, at[part] - step)
        for component, contexts, now, before in zip(components, kinds, here, coarse, strict=True):
            emitter.emit_by_context(TableKey(channel.stream, component, step, 0), contexts, now - 3 * before)
        return here

    for step in steps_coded(before, after):
        chosen = np.flatnonzero((before < step) & (after >= step))
        if not len(chosen):
            continue
        if predicted is not None and predicted.covers(step):
            coarse = np.where(step > 1, coarsen(values, np.maximum(at - step + 1, 0)[:, None]), 0)
            _code_predicted(channel, step, chosen, coarse, predicted, put)
            continue
        for component, (contexts, symbols) in enumerate(zip(*_symbols(values, at, chosen, step), strict=True)):
            emitter.emit_by_context(TableKey(channel.stream, component, step, 0), contexts, symbols)
        if predicted is not None:
            predicted.settle(step, chosen, coarsen(values[chosen], (at[chosen] - step)[:, None]))


def _symbols(values: Ints, at: I64, chosen: I64, step: int) -> tuple[Ints, Ints]:
    """(components, m) contexts and symbols of a step of the anchors `chosen`; the rest as for :func:`put_channel`."""
    native = library()
    if native is None:
        here = coarsen(values[chosen].T, at[chosen] - step)
        coarse = coarsen(here, 1) if step > 1 else np.zeros_like(here)
        return (trit_contexts(coarse) if step > 1 else coarse), here - 3 * coarse
    final, components = np.ascontiguousarray(values, np.int32), values.shape[1]
    contexts, symbols = np.empty((components, len(chosen)), np.uint8), np.empty((components, len(chosen)), np.int32)
    given = final.ctypes.data, components, at.ctypes.data, chosen.ctypes.data, len(chosen), step
    native.scar_steps(*given, contexts.ctypes.data, symbols.ctypes.data)
    return contexts, symbols


def get_channel(
    reader: SymbolReader,
    channel: Channel,
    before: I64,
    after: I64,
    values: I32,
    predicted: PredictedChannel | None = None,
) -> None:
    """Read the steps before+1..after of every anchor of a tile, in place.

    Args:
        values: (n, components) int32, v at `before` steps on entry, at `after` on return.
        predicted: the channel's predictors, if it has any.

    Raises:
        Malformed: ``bad-trit`` or ``value-range`` for symbols outside SPEC §7.5.
    """

    def get(part: I64, step: int, components: Sequence[int], kinds: Sequence[I64], coarse: I64) -> I64:
        symbols = _read_components(reader, channel, step, components, kinds)
        here = _in_range(symbols if step == 1 else 3 * coarse + _check_trits(symbols), channel)
        values[part[:, None], components] = here.T
        return here

    for step in steps_coded(before, after):
        chosen = np.flatnonzero((before < step) & (after >= step))
        if not len(chosen):
            continue
        if predicted is not None and predicted.covers(step):
            _code_predicted(channel, step, chosen, values, predicted, get)
            continue
        if step == 1:
            kinds = [np.zeros(len(chosen), np.int64)] * channel.components
            here = _read_components(reader, channel, 1, range(channel.components), kinds)
            values[chosen] = _in_range(here, channel).T
        else:
            values[chosen] = _refine(reader, channel, step, values[chosen]).T
        if predicted is not None:
            predicted.settle(step, chosen, values[chosen])


def steps_coded(before: I64, after: I64) -> range:
    """The steps that some anchor may receive, from (n,) steps before and after a layer."""
    moves = np.flatnonzero(before < after)
    return range(int(before[moves].min()) + 1, int(after[moves].max()) + 1) if len(moves) else range(0)


def steps_between(before: I64, after: I64) -> range:
    """A range of steps that covers all coded ones, and perhaps others: trying a step is cheaper than finding out."""
    return range(int(before.min()) + 1, int(after.max()) + 1) if len(before) else range(0)


def _code_predicted(
    channel: Channel,
    step: int,
    chosen: I64,
    values: Ints,
    predicted: PredictedChannel,
    exchange: Exchange,
) -> None:
    """Code one step of the anchors `chosen` pass by pass, components in order (SPEC §10.3); either direction.

    Args:
        values: (n, components) values before this step; 0 before the first.
    """
    every = range(channel.components)
    for part in predicted.parts(step, chosen):
        # The components of a first step are context for each other; later steps need no component's news.
        for components in [[c] for c in every] if step == 1 else [list(every)]:
            coarse = values[part[:, None], components].T.astype(np.int64)
            kinds = []
            for component, before in zip(components, coarse, strict=True):
                found = predicted.contexts(component)
                if found is None:
                    found = trit_contexts(before) if step > 1 else np.zeros(len(part), np.int64)
                kinds.append(found)
            for component, now in zip(components, exchange(part, step, components, kinds, coarse), strict=True):
                predicted.know(component, now)


def _read_components(
    reader: SymbolReader, channel: Channel, step: int, components: Sequence[int], kinds: Sequence[I64]
) -> I64:
    """(components, n) symbols, component by component, each grouped by ascending context."""
    keys = np.concatenate([place * CONTEXTS + numbers for place, numbers in enumerate(kinds)])
    key = StepKey(channel.stream, tuple(components), step)
    return reader.read_grouped(key, keys).astype(np.int64).reshape(len(components), -1)


def _refine(reader: SymbolReader, channel: Channel, step: int, values: Ints) -> Ints:
    """(components, n) values after ternary step `step`, of (n, components) int32 values before it.

    No component's context depends on another's refinement: all are sorted into their contexts at once. Arrays are
    as narrow as their values allow, since this is where most of a decode goes.
    """
    coarse = np.ascontiguousarray(values.T)
    keys = np.clip(coarse, -2, 2).astype(np.int16)
    keys += (2 + CONTEXTS * np.arange(len(coarse), dtype=np.int16))[:, None]
    key = StepKey(channel.stream, tuple(range(len(coarse))), step)
    trits = _check_trits(reader.read_grouped(key, keys.ravel())).astype(np.int8).reshape(coarse.shape)
    if _reach_of(coarse) > VALUE_LIMIT // 3 - 1:
        return _in_range(3 * coarse.astype(np.int64) + trits, channel)
    coarse *= 3
    coarse += trits
    return coarse


def _reach_of(values: Ints) -> int:
    return max(int(values.max()), -int(values.min())) if values.size else 0


def _in_range(values: I64, channel: Channel) -> I64:
    if _reach_of(values) > VALUE_LIMIT:
        raise Malformed("value-range", "a channel value leaves 32 bits (SPEC §7.5)", field=channel.stream.name)
    return values


def _check_trits(trits: Ints) -> Ints:
    if _reach_of(trits) > 1:
        raise Malformed("bad-trit", "a refinement is not -1, 0 or 1 (SPEC §7.5)", field="trit")
    return trits


@lru_cache(maxsize=256)
def width_table(step: tuple[float, ...]) -> F64:
    """(21, components) float64: a row for each number of steps, as in :func:`cell_widths`. Not to be changed."""
    table = np.zeros((MAX_STEPS + 1, len(step)))
    table[1:] = np.asarray(step, np.float64) / np.power(3.0, np.arange(MAX_STEPS))[:, None]
    table.flags.writeable = False
    return table


def cell_widths(step: Sequence[float], steps: I64) -> F64:
    """(n, components) float64: step / 3^(n - 1) for each anchor's number of steps n; 0 where n is 0 (SPEC §9.2).

    Args:
        step: (components) first cell widths.
        steps: (n,) ternary steps received, 0..20.
    """
    return width_table(tuple(step)).take(steps, axis=0)


def channel_values(values: Ints, step: Sequence[float], steps: I64) -> F32:
    """(n, components) float32 values of a channel: binary32(binary64(v) * cell width) (SPEC §9.2).

    Args:
        values: (n, components) int32, v after `steps` steps.
        step: (components) first cell widths.
        steps: (n,) ternary steps received, 0..20.
    """
    return in_binary32(values, cell_widths(step, steps))


def in_binary32(values: Ints, widths: F64) -> F32:
    """binary32(binary64(v) * width) of integers and widths whose shapes fit (SPEC §9.2)."""
    with np.errstate(over="ignore", under="ignore"):  # an infinity or a zero is what rounding prescribes
        return (values.astype(np.float64) * widths).astype(np.float32)


def check_reach(values: Ints, step: Sequence[float], steps: I64) -> None:
    """Check that position residuals keep anchors by their cell (SPEC §9.1), after every layer.

    Args:
        values: (n, 3) int32, v after `steps` steps.
        step, steps: as for :func:`cell_widths`.

    Raises:
        Malformed: ``value-range``.
    """
    if bool((np.abs(values * cell_widths(step, steps)) > REACH).any()):
        message = "a position residual is not in -1..1 cells (SPEC §9.1)"
        raise Malformed("value-range", message, field=Stream.POSITION_RESIDUAL.name)
