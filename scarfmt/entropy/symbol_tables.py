"""Static tables: frequencies over sparse alphabets, and those in force in a layer (SPEC §8.3).

Alphabets are sparse: a table lists the values it can code, so a value nobody used costs nothing and an outlier costs
two bytes, not a wide alphabet.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scarfmt.arrays import I64, Ints
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


class StepTables:
    """The tables of a step side by side, for symbols of many kinds at once.

    Args:
        key: the step.
        tables: in force.
    """

    def __init__(self, key: StepKey, tables: Mapping[TableKey, SymbolTable]) -> None:
        joint, first, past = ([np.zeros(0, np.int64)] for _ in range(3))
        for kind in range(CONTEXTS * len(key.components)):
            table = tables.get(key.table(kind))
            if table is not None:
                joint.append((kind << JOINT_BITS) + table.alphabet + JOINT_ZERO)
                first.append(table.table.cumulative[:-1])
                past.append(table.table.cumulative[1:])
        self._joint, self._first, self._past = map(np.concatenate, (joint, first, past))

    def spans(self, kinds: Ints, values: Ints) -> tuple[I64, I64]:
        """(n,) first slots of symbols in their tables, and slots past the last, of (n,) kinds and values.

        Raises:
            InvalidInput: ``input-symbol`` for a value that no table holds.
        """
        wanted = (kinds.astype(np.int64) << JOINT_BITS) + values + JOINT_ZERO
        found = np.minimum(np.searchsorted(self._joint, wanted), len(self._joint) - 1)
        if not len(self._joint) or not np.array_equal(self._joint[found], wanted):
            raise InvalidInput("input-symbol", "a value that no table holds", field="symbols")
        return self._first[found], self._past[found]


class StaticTables(dict[TableKey, SymbolTable]):
    """The static tables in force in a layer, by key. They do not change."""

    @classmethod
    def of(cls, tables: Mapping[TableKey, SymbolTable]) -> StaticTables:
        """`tables` themselves where they are of this class, else a copy that is."""
        return tables if isinstance(tables, StaticTables) else cls(tables)

    @cached_property
    def _steps(self) -> dict[StepKey, StepTables]:
        return {}

    def step(self, key: StepKey) -> StepTables:
        """The tables of a step side by side, made once."""
        if key not in self._steps:
            self._steps[key] = StepTables(key, self)
        return self._steps[key]


def missing_table(key: TableKey) -> Malformed:
    """The refusal of a symbol whose table was not sent."""
    return Malformed("missing-table", f"no static table for {key} (SPEC §8.3)", field="tables")
