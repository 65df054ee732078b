"""Choosing which already coded values predict the next (SPEC §8.4; encoder side).

For every component the candidates are: no context, the class, and class plus one earlier component. The
cheapest by measured bits, tables included, is taken.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from reference_encoder.allocate import entropy_bits
from scarfmt.codecs.channels import contexts
from scarfmt.model import ContextRule
from scarfmt.schema import Stream

I64 = NDArray[np.int64]

_SAMPLE = 200_000


def choose_rules(streams: Sequence[Stream], firsts: Sequence[I64], classes: I64) -> list[tuple[ContextRule, ...]]:
    """One rule per component per channel.

    Args:
        streams: channels in coding order.
        firsts: (N, components) first-step values of each.
        classes: (N,) class numbers.
    """
    stride = max(1, len(classes) // _SAMPLE)
    sample = [first[::stride] for first in firsts]
    kinds = classes[::stride]
    scale = len(classes) / max(len(kinds), 1)
    out = []
    for channel, first in enumerate(sample):
        rules = []
        for component in range(first.shape[1]):
            rules.append(_best_rule(channel, component, sample, kinds, scale, streams))
        out.append(tuple(rules))
    return out


def _best_rule(
    channel: int, component: int, firsts: Sequence[I64], classes: I64, scale: float, streams: Sequence[Stream]
) -> ContextRule:
    candidates = [ContextRule(by_class=False), ContextRule(by_class=True)]
    if streams[channel] != Stream.POSITION_RESIDUAL:
        candidates += _sources(channel, component, firsts, streams)
    values = firsts[channel][:, component]

    def cost(rule: ContextRule) -> float:
        kinds = contexts(rule, classes, firsts)
        tables = 8.0 * len(np.unique(kinds * 4096 + values - values.min())) if len(values) else 0.0
        return (entropy_bits(values, kinds) - tables) * scale + tables

    return min(candidates, key=cost)


def _sources(channel: int, component: int, firsts: Sequence[I64], streams: Sequence[Stream]) -> list[ContextRule]:
    rules = []
    for source in range(channel + 1):
        if streams[source] == Stream.POSITION_RESIDUAL:
            continue
        for part in range(firsts[source].shape[1] if source < channel else component):
            values = firsts[source][:, part]
            low, high = (int(q) for q in np.percentile(values, [2, 98]))
            shift = max(0, int(high - low + 1).bit_length() - 4)
            rules += [ContextRule(flag, source, part, low, shift) for flag in (False, True)]
    return rules
