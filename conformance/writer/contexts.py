"""Symbols of channel steps, and the contexts that choose their tables (SPEC §7.5, §8.4)."""

from __future__ import annotations

from conformance.writer.anchors import Anchors

Place = tuple[int, int, int]
"""Channel, component, step."""


def step_symbols(anchors: Anchors, place: Place, chosen: list[int]) -> list[int]:
    """v_1, or the refinement v_n - 3 v_(n-1), of the anchors chosen."""
    i, j, n = place
    here, coarser = anchors.at(i, n), anchors.at(i, n - 1)
    return [here[a][j] - 3 * coarser[a][j] for a in chosen]


def table_contexts(anchors: Anchors, place: Place, chosen: list[int]) -> list[int]:
    """The contexts of a channel without predictors (SPEC §8.4)."""
    i, j, n = place
    if n == 1:
        return [0] * len(chosen)
    values = anchors.at(i, n - 1)
    return [min(max(values[a][j], -2), 2) + 2 for a in chosen]
