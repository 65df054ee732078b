"""Frequency tables, their records, and rANS (SPEC §8.1 to §8.3)."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

from conformance.writer.fields import svarint, varint

TOTAL_BITS = 24
TOTAL = 1 << TOTAL_BITS
MAX_TABLE_WEIGHT = TOTAL - 1

Interval = tuple[int, int]
"""The start of a symbol's cumulative frequency, and its frequency."""


class Table(NamedTuple):
    """A table record.

    Attributes:
        values: the alphabet, ascending, 1..4096 of them.
        weights: of each, 1..2^24 - 1.
    """

    values: tuple[int, ...]
    weights: tuple[int, ...]


Tables = Mapping[int, Table]
"""By key: stream << 24 | component << 16 | step << 8 | context."""


def cumulative(weights: Sequence[int]) -> list[int]:
    """c_0 .. c_n of n weights."""
    n, total, before, out = len(weights), sum(weights), 0, []
    for i, weight in enumerate([*weights, 0]):
        out.append(before * (TOTAL - n) // total + i)
        before += weight
    return out


@lru_cache(maxsize=4096)
def uniform_cumulative(size: int) -> tuple[int, ...]:
    """c_0 .. c_n of the uniform table of n symbols."""
    return tuple(cumulative([1] * size))


def intervals(table: Table) -> dict[int, Interval]:
    """The interval of each value of an alphabet."""
    spans = pairwise(cumulative(table.weights))
    return {value: (low, past - low) for value, (low, past) in zip(table.values, spans, strict=True)}


def rans(symbols: Sequence[Interval]) -> bytes:
    """The stream of symbols in decoding order; one of the only symbol of its table, (0, 2^24), takes nothing."""
    state, words = 0, []
    for start, frequency in reversed(symbols):
        if frequency == TOTAL:
            continue
        if state >> 40 >= frequency:
            words.append(state & 0xFFFFFFFF)
            state >>= 32
        quotient, rest = divmod(state, frequency)
        state = (quotient << TOTAL_BITS) + start + rest
    while state:
        words.append(state & 0xFFFFFFFF)
        state >>= 32
    return struct.pack(f"<{len(words)}I", *words)


def table_records(tables: Tables) -> bytes:
    """The content of a TABLES block."""
    return varint(len(tables)) + b"".join(_record(key, tables[key]) for key in sorted(tables))


def _record(key: int, table: Table) -> bytes:
    gaps = [past - value - 1 for value, past in pairwise(table.values)]
    head = [varint(key), varint(len(table.values)), svarint(table.values[0])]
    return b"".join([*head, *map(varint, gaps), *map(varint, table.weights)])
