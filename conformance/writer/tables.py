"""The tables that a layer sends (SPEC §8.3). The rules, in integers:

A value's weight is its count, scaled so that the largest is top = max(largest count, 7), at most 2^24 - 1:
w = max((2 * count * top + largest) // (2 * largest), 1). So weights are the counts themselves but where symbols are
few; those of the worked file of SPEC.md, §4.2, come out as 7. A layer goes on with the table of an earlier one as
long as that has all the values: comparing sizes would take a logarithm.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from conformance.writer.entropy import MAX_TABLE_WEIGHT, Table, Tables
from conformance.writer.options import Renewal, Weights, WriteOptions
from conformance.writer.substream import Substream

_LEAST_TOP = 7


def layer_tables(streams: Iterable[Substream], known: Tables, layer: int, options: WriteOptions) -> dict[int, Table]:
    """The tables of a layer's TABLES block.

    Args:
        streams: the symbols of all tiles.
        known: the tables in force before.
    """
    counts: dict[int, Counter[int]] = {}
    for stream in streams:
        for key, counter in stream.counts():
            counts.setdefault(key, Counter()).update(counter)
    sent = dict(known) if options.renewal == Renewal.REPEATED else {}
    for key, counter in counts.items():
        table = known.get(key)
        enough = table is not None and set(counter) <= set(table.values) and options.renewal != Renewal.ALWAYS
        if options.fitted and not enough:
            sent[key] = _table(counter, options)
    return {**sent, **options.tables.get(layer, {})}


def _table(counter: Counter[int], options: WriteOptions) -> Table:
    values = tuple(sorted({*counter, *options.unused}))
    return Table(values, tuple(_weights([counter[value] for value in values], options.weights)))


def _weights(counts: list[int], weights: Weights) -> list[int]:
    if weights == Weights.UNIFORM:
        return [1] * len(counts)
    if weights == Weights.STEEP:
        return [1] * (len(counts) - 1) + [MAX_TABLE_WEIGHT]
    largest = max(counts)
    top = min(max(largest, _LEAST_TOP), MAX_TABLE_WEIGHT)
    scaled = [max((2 * count * top + largest) // (2 * largest), 1) for count in counts]
    return scaled[::-1] if weights == Weights.REVERSED else scaled
