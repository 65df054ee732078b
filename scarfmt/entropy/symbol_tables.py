"""Static tables: frequencies over sparse alphabets, and those in force in a layer (SPEC §8.3).

Alphabets are sparse: a table lists the values it can code, so a value nobody used costs nothing and an outlier costs
two bytes, not a wide alphabet.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from scarfmt.arrays import I64, U16, Ints
from scarfmt.entropy.keys import CONTEXTS, StepKey, TableKey
from scarfmt.entropy.rans import FrequencyTable
from scarfmt.errors import InvalidInput, Malformed


@dataclass(frozen=True)
class SymbolTable:
    """Frequencies over a sparse alphabet of integers.

    Attributes:
        alphabet: (n,) int64, strictly ascending values.
        weights: (n,) int64, each >= 1, their sum below 2^39.
    """

    alphabet: I64
    weights: I64

    @cached_property
    def table(self) -> FrequencyTable:
        """The frequency table of the weights (SPEC §8.1); made when something is coded with it."""
        return FrequencyTable.from_weights(self.weights)

    def cost_of_counts(self, alphabet: I64, counts: I64) -> float:
        """Bits to code `counts` symbols of each value of `alphabet`; infinite if one is not codable."""
        slots = np.minimum(np.searchsorted(self.alphabet, alphabet), len(self.alphabet) - 1)
        if not np.array_equal(self.alphabet[slots], alphabet):
            return float("inf")
        return float((self.table.bits[slots] * counts).sum())


JOINT_BITS = 33
"""A joint number is kind * 2^33 + value + 2^32."""
JOINT_ZERO = 1 << 32


class StreamTables:
    """The tables of a stream side by side, for symbols of many groups at once.

    Args:
        stream: which.
        tables: in force.
    """

    def __init__(self, stream: int, tables: Mapping[TableKey, SymbolTable]) -> None:
        joint, first, past = ([np.zeros(0, np.int64)] for _ in range(3))
        for key in sorted(key for key in tables if key.stream == stream):
            table = tables[key]
            joint.append((_place(key.component, key.step, key.context) << JOINT_BITS) + table.alphabet + JOINT_ZERO)
            first.append(table.table.cumulative[:-1])
            past.append(table.table.cumulative[1:])
        self._joint, self._first, self._past = map(np.concatenate, (joint, first, past))

    def spans(self, steps: Sequence[StepKey], which: I64, kinds: U16, values: Ints) -> tuple[I64, I64]:
        """(n,) first slots of symbols in their tables, and slots past the last.

        Args:
            steps: some steps of the stream.
            which: (n,) numbers of the symbols' steps.
            kinds, values: (n,) of the symbols.

        Raises:
            InvalidInput: ``input-symbol`` for a value that no table holds.
        """
        most = max(len(step.components) for step in steps)
        components = np.array([(*step.components, *[0] * (most - len(step.components))) for step in steps])
        step = np.array([step.step for step in steps])[which]
        place = _place(components[which, kinds // CONTEXTS], step, kinds % CONTEXTS)
        wanted = (place << JOINT_BITS) + values + JOINT_ZERO
        found = np.minimum(np.searchsorted(self._joint, wanted), len(self._joint) - 1)
        if not len(self._joint) or not np.array_equal(self._joint[found], wanted):
            raise InvalidInput("input-symbol", "a value that no table holds", field="symbols")
        return self._first[found], self._past[found]


def _place(component: I64 | int, step: I64 | int, context: U16 | int) -> Any:
    """Orders the tables of a stream as their keys do."""
    return (component * 256 + step) * CONTEXTS + context


class StaticTables(dict[TableKey, SymbolTable]):
    """The static tables in force in a layer, by key. They do not change."""

    @classmethod
    def of(cls, tables: Mapping[TableKey, SymbolTable]) -> StaticTables:
        """`tables` themselves where they are of this class, else a copy that is."""
        return tables if isinstance(tables, StaticTables) else cls(tables)

    @cached_property
    def _streams(self) -> dict[int, StreamTables]:
        return {}

    def stream(self, stream: int) -> StreamTables:
        """The tables of a stream side by side, made once."""
        if stream not in self._streams:
            self._streams[stream] = StreamTables(stream, self)
        return self._streams[stream]


def missing_table(key: TableKey) -> Malformed:
    """The refusal of a symbol whose table was not sent."""
    return Malformed("missing-table", f"no static table for {key} (SPEC §8.3)", field="tables")
