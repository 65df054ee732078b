"""The tables that a layer sends (SPEC §8.3). The rules, in integers:

A value's weight is its count, scaled so that the largest is top = max(largest count, 7), at most 2^24 - 1:
w = max((2 * count * top + largest) // (2 * largest), 1). So weights are the counts themselves but where symbols are
few; those of the worked file of SPEC.md, §4.2, come out as 7. A layer goes on with the table of an earlier one as
long as that has all the values: comparing sizes would take a logarithm.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from conformance.writer.options import MAX_TABLE_WEIGHT, Renewal, Tables, Weights, WriteOptions
from scarfmt.coding.writer import Histogram
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.symbol_tables import SymbolTable

_LEAST_TOP = 7


def table_of(values: Sequence[int], weights: Sequence[int]) -> SymbolTable:
    """A table of these ascending values, each with its weight."""
    return SymbolTable(np.array(values, np.int64), np.array(weights, np.int64))


def layer_tables(
    histograms: Histogram, known: Tables, layer: int, options: WriteOptions
) -> dict[TableKey, SymbolTable]:
    """The tables of a layer's TABLES block.

    Args:
        histograms: of the symbols of all tiles.
        known: the tables in force before.
    """
    sent = dict(known) if options.renewal == Renewal.REPEATED else {}
    for key, (alphabet, counts) in histograms.items():
        enough = key in known and known[key].places(alphabet) is not None and options.renewal != Renewal.ALWAYS
        if options.fitted and not enough:
            sent[key] = _table(dict(zip(alphabet.tolist(), counts.tolist(), strict=True)), options)
    return {**sent, **options.tables.get(layer, {})}


def _table(counts: dict[int, int], options: WriteOptions) -> SymbolTable:
    values = sorted({*counts, *options.unused})
    return table_of(values, _weights([counts.get(value, 0) for value in values], options.weights))


def _weights(counts: list[int], weights: Weights) -> list[int]:
    if weights == Weights.UNIFORM:
        return [1] * len(counts)
    if weights == Weights.STEEP:
        return [1] * (len(counts) - 1) + [MAX_TABLE_WEIGHT]
    largest = max(counts)
    top = min(max(largest, _LEAST_TOP), MAX_TABLE_WEIGHT)
    scaled = [max((2 * count * top + largest) // (2 * largest), 1) for count in counts]
    return scaled[::-1] if weights == Weights.REVERSED else scaled
