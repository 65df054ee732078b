"""Channel sub-streams: a first value, then exact ternary refinements (SPEC §7.5; the paper's trits).

With n steps received the quantised value is v_n, an integer; v_n = 3 v_(n-1) + t with t in {-1, 0, 1}, and
the attribute is v_n * step / 3^(n-1). Cells nest, so any prefix of steps is itself a rounding to nearest.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.errors import Malformed
from scarfmt.model import NO_SOURCE, Channel, ContextRule
from scarfmt.symbols import Emitter, SymbolReader, TableKey, emit_by_context, read_by_context

I64 = NDArray[np.int64]
Ints = NDArray[np.integer[Any]]

_SOURCE_CONTEXTS = 16
_VALUE_LIMIT = (1 << 31) - 1
# First-step values of the channels decoded so far, one (n, components) array a channel.
FirstValues = Sequence[Ints]


def coarsen(values: Ints, steps: I64 | int) -> I64:
    """Drop `steps` ternary digits of `values`, rounding to nearest: v_n -> v_(n - steps) (SPEC §7.5)."""
    power = np.power(3, np.asarray(steps, np.int64))
    return (np.asarray(values, np.int64) + (power - 1) // 2) // power


def contexts(rule: ContextRule, classes: I64, first: FirstValues, chosen: I64 | slice = slice(None)) -> I64:
    """(n,) int64 context numbers of first-step symbols: class * 16 + source bucket (SPEC §8.4).

    Args:
        classes: (n,) classes of the anchors concerned.
        first: first-step values of all anchors of the tile; its rows `chosen` are those concerned.
    """
    out = classes * _SOURCE_CONTEXTS if rule.by_class else np.zeros(len(classes), np.int64)
    if rule.source_channel != NO_SOURCE:
        # int64: `low` may be any 33-bit integer, and the difference must not wrap.
        source = first[rule.source_channel][chosen, rule.source_component].astype(np.int64)
        out = out + np.clip((source - rule.low) >> rule.shift, 0, _SOURCE_CONTEXTS - 1)
    return out


def trit_contexts(rule: ContextRule, classes: I64, values: I64) -> I64:
    """(n,) int64 context numbers of a ternary step: class * 16 + the value refined, clamped to -2..2, + 2."""
    out = classes * _SOURCE_CONTEXTS if rule.by_class else np.zeros(len(classes), np.int64)
    return out + np.clip(values, -2, 2) + 2


def put_channel(
    emitter: Emitter,
    channel: Channel,
    classes: I64,
    before: I64,
    after: I64,
    final: tuple[Ints, I64],
    first: FirstValues,
) -> None:
    """Emit the steps before+1..after of every anchor of a tile.

    Args:
        classes, before, after: (n,) class and steps of each anchor before and after this layer.
        final: (n, components) values and (n,) the step counts they are at, each >= `after`.
        first: first-step values of all channels up to and including this one.
    """
    values, at = final
    for step in range(int(before.min(initial=0)) + 1, int(after.max(initial=0)) + 1):
        chosen = np.flatnonzero((before < step) & (after >= step))
        if not len(chosen):
            continue
        kinds = classes[chosen]
        for component, rule in enumerate(channel.rules):
            key = TableKey(channel.stream, component, step, 0)
            here = coarsen(values[chosen, component], at[chosen] - step)
            if step == 1:
                emit_by_context(emitter, key, contexts(rule, kinds, first, chosen), here)
            else:
                coarse = coarsen(here, 1)
                emit_by_context(emitter, key, trit_contexts(rule, kinds, coarse), here - 3 * coarse)


def get_channel(
    reader: SymbolReader,
    channel: Channel,
    classes: I64,
    before: I64,
    after: I64,
    values: Ints,
    first: FirstValues,
) -> None:
    """Read the steps before+1..after of every anchor of a tile, in place.

    Args:
        values: (n, components) int32, v at `before` steps on entry, at `after` on return.
        first: first-step values of the channels up to and including this one; the last array is written.

    Raises:
        Malformed: ``bad-trit`` or ``value-range`` for symbols outside SPEC §7.5.
    """
    for step in range(int(before.min(initial=0)) + 1, int(after.max(initial=0)) + 1):
        chosen = np.flatnonzero((before < step) & (after >= step))
        if not len(chosen):
            continue
        kinds = classes[chosen]
        for component, rule in enumerate(channel.rules):
            key = TableKey(channel.stream, component, step, 0)
            if step == 1:
                here = read_by_context(reader, key, contexts(rule, kinds, first, chosen))
                first[-1][chosen, component] = here
            else:
                coarse = values[chosen, component].astype(np.int64)
                trit = read_by_context(reader, key, trit_contexts(rule, kinds, coarse))
                here = 3 * coarse + _checked(trit)
            if len(here) and int(np.abs(here).max()) > _VALUE_LIMIT:
                raise Malformed("value-range", "a channel value leaves 32 bits (SPEC §7.5)", field=channel.stream.name)
            values[chosen, component] = here


def _checked(trits: I64) -> I64:
    if bool((np.abs(trits) > 1).any()):
        raise Malformed("bad-trit", "a refinement is not -1, 0 or 1 (SPEC §7.5)", field="trit")
    return trits
