"""The tables that a layer sends, and TABLES blocks (SPEC §8.3).

A value's weight is its count. A layer goes on with the table of an earlier one as long as that has all the values:
comparing sizes would take a logarithm.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from conformance.writer.numbers import Number
from conformance.writer.options import MAX_TABLE_WEIGHT, Renewal, Tables, Weights, WriteOptions
from scarfmt.coding.writer import Histogram
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.symbol_tables import SymbolTable

_MOST_PRECISION = 23


class Record(NamedTuple):
    """A table of a TABLES block: the number of its key, its ascending values, a weight for each."""

    key: int
    values: Sequence[int]
    weights: Sequence[int]

    @property
    def digits(self) -> tuple[int, int, int, int]:
        """Stream kind, component, step and context."""
        return self.key >> 24, self.key >> 16 & 255, self.key >> 8 & 255, self.key & 255


def table_numbers(records: Sequence[Record]) -> list[Number]:
    """The numbers of a TABLES block of tables with ascending keys; nothing is checked."""
    out: list[Number] = [(("table_count",), len(records))]
    before = (0, 0, 0, 0)
    for record in records:
        out += [*_key(before, record.digits), *_record(record)]
        before = record.digits
    return out


def _key(before: Sequence[int], digits: Sequence[int]) -> Iterator[Number]:
    same = 1
    for i, (old, digit) in enumerate(zip(before, digits, strict=True)):
        yield ("key", i, same), digit - same * (old + (i == 3))
        same &= old == digit


def _record(record: Record) -> Iterator[Number]:
    kind, values = min(record.digits[2], 2), record.values
    yield ("more", kind), len(values) - 1
    yield ("first", kind), fold(values[0])
    yield from ((("gaps", kind), after - before - 1) for before, after in pairwise(values))
    if len(values) > 1:
        precision = min(max(record.weights).bit_length() - 1, _MOST_PRECISION)
        yield ("precision", kind), precision
        yield from ((("weights", precision), weight - 1) for weight in record.weights)


def fold(value: int) -> int:
    """A signed number as one of 0 or more: 0, -1, 1, -2, ... as 0, 1, 2, 3, ..."""
    return 2 * value if value >= 0 else -2 * value - 1


def table_of(values: Sequence[int], weights: Sequence[int]) -> SymbolTable:
    """A table of these ascending values, each with its weight."""
    return SymbolTable(np.array(values, np.int64), np.array(weights, np.int64))


def layer_tables(
    histograms: Histogram, known: Tables, layer: int, options: WriteOptions
) -> dict[TableKey, SymbolTable]:
    """The tables of a layer's TABLES block."""
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
    shares = [max(count, 1) for count in counts]
    return shares[::-1] if weights == Weights.REVERSED else shares
