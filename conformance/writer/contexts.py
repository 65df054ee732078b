"""Symbols of channel steps, and the contexts that choose their tables (SPEC §7.5, §8.4)."""

from __future__ import annotations

from conformance.writer.anchors import Anchors

NO_SOURCE = 255

Place = tuple[int, int, int]
"""Channel, component, step."""


def step_symbols(anchors: Anchors, place: Place, chosen: list[int]) -> list[int]:
    """v_1, or the refinement v_n - 3 v_(n-1), of the anchors chosen."""
    i, j, n = place
    here, coarser = anchors.at(i, n), anchors.at(i, n - 1)
    return [here[a][j] - 3 * coarser[a][j] for a in chosen]


def table_contexts(anchors: Anchors, place: Place, chosen: list[int]) -> list[int]:
    """first_contexts and trit_contexts of SPEC §8.4."""
    i, j, n = place
    rule = anchors.model.channels[i].rules[j]
    contexts = [16 * anchors.classes[a] if rule.by_class else 0 for a in chosen]
    if n > 1:
        values = anchors.at(i, n - 1)
        return [c + min(max(values[a][j], -2), 2) + 2 for c, a in zip(contexts, chosen, strict=True)]
    if rule.source_channel == NO_SOURCE:
        return contexts
    source = anchors.first[rule.source_channel]
    shown = [(source[a][rule.source_component] - rule.low) >> rule.shift for a in chosen]
    return [c + min(max(s, 0), 15) for c, s in zip(contexts, shown, strict=True)]
