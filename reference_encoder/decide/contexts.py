"""Choosing which already coded values predict the next (SPEC §8.4; encoder side).

For every component the candidates are: no context, the class, and class plus one earlier component. The
cheapest by measured bits, tables included, is taken.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from reference_encoder.tuning import CONTEXT_ANCHORS, TABLE_ENTRY_BITS
from scarfmt.arrays import F64, I64
from scarfmt.codecs.channels import contexts
from scarfmt.container.schema import Stream
from scarfmt.scene.model import ContextRule

_MOST_BINS = 1 << 20
"""Histograms with more possible entries are made by sorting."""


def enough_anchors(count: int) -> slice:
    """A slice of `count` anchors, large enough to choose rules by."""
    return slice(None, None, max(1, count // CONTEXT_ANCHORS))


def choose_rules(
    streams: Sequence[Stream], firsts: Sequence[I64], classes: I64, count: float | None = None
) -> list[tuple[ContextRule, ...]]:
    """One rule per component per channel.

    Args:
        streams: channels in coding order.
        firsts: (n, components) first-step values of each, of the anchors :func:`enough_anchors`.
        classes: (n,) their class numbers.
        count: how many anchors there are; None for n.
    """
    scale = 1.0 if count is None else count / max(len(classes), 1)
    nothing = np.zeros(len(classes), np.int64)
    sources: list[_Source] = []
    out = []
    for channel, first in enumerate(firsts):
        rules = []
        for component, column in enumerate(first.T):
            values = np.unique(column, return_inverse=True)[1]
            candidates = list(_rules(_Source(ContextRule(), nothing), values, classes, scale))
            if streams[channel] != Stream.POSITION_RESIDUAL:
                candidates += [pair for source in sources for pair in _rules(source, values, classes, scale)]
                sources.append(_Source.of(channel, component, column))
            rules.append(min(candidates, key=lambda pair: pair[0])[1])
        out.append(tuple(rules))
    return out


@dataclass(frozen=True)
class _Source:
    """A rule without the class, and the (n,) context numbers that it gives."""

    rule: ContextRule
    buckets: I64

    @classmethod
    def of(cls, channel: int, component: int, values: I64) -> _Source:
        """Buckets of an earlier component's (n,) first-step values: most of their range is spread over all."""
        low, high = (int(q) for q in np.percentile(values, [2, 98])) if len(values) else (0, 0)
        shift = max(0, int(high - low + 1).bit_length() - 4)
        alone = ContextRule(False, 0, 0, low, shift)
        buckets = contexts(alone, np.zeros(len(values), np.int64), [values[:, None].astype(np.int32)])
        return cls(replace(alone, source_channel=channel, source_component=component), buckets)


def _rules(source: _Source, values: I64, classes: I64, scale: float) -> Iterator[tuple[float, ContextRule]]:
    """(bits, rule) of a source without and with the class; (n,) `values` are numbered 0, 1, 2, .."""
    width, buckets = int(values.max(initial=0)) + 1, int(source.buckets.max(initial=0)) + 1
    bins = buckets * width
    joint = (classes * buckets + source.buckets) * width + values
    if (int(classes.max(initial=0)) + 1) * bins <= _MOST_BINS:
        counts = np.bincount(joint)
        cells = np.flatnonzero(counts)
        counts = counts[cells]
    else:
        cells, counts = np.unique(joint, return_counts=True)
    # One count for both: added up over the classes it is that of the rule without them.
    pooled = np.bincount(cells % bins, counts, bins)
    used = np.flatnonzero(pooled)
    yield _bits(used // width, pooled[used], scale), replace(source.rule, by_class=False)
    yield _bits(cells // width, counts, scale), replace(source.rule, by_class=True)


def _bits(contexts: I64, counts: I64 | F64, scale: float) -> float:
    """Bits of `scale` times as many symbols as were counted, and of their tables.

    Args:
        contexts, counts: (m,) of every context and value that occur together.
    """
    totals = np.bincount(contexts, counts)[contexts]
    return scale * float((counts * np.log2(totals / counts)).sum()) + TABLE_ENTRY_BITS * len(counts)
