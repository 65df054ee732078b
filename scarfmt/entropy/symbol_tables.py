"""Static tables: frequencies over sparse alphabets, and those in force in a layer (SPEC §8.3).

Alphabets are sparse: a table lists the values it can code, so a value nobody used costs nothing and an outlier costs
two bytes, not a wide alphabet.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scarfmt.arrays import I64
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.rans import FrequencyTable
from scarfmt.errors import Malformed
from scarfmt.kept import Keeper


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


class StaticTables(dict[TableKey, SymbolTable], Keeper):
    """The static tables in force in a layer, by key. They do not change: an engine keeps what it made of them."""

    @classmethod
    def of(cls, tables: Mapping[TableKey, SymbolTable]) -> StaticTables:
        """`tables` themselves where they are of this class, else a copy that is."""
        return tables if isinstance(tables, StaticTables) else cls(tables)

    def contexts(self, stream: int, component: int, step: int) -> Sequence[int]:
        """The contexts of a step of a component that have a table."""
        return self._contexts.get((stream, component, step), ())

    @cached_property
    def _contexts(self) -> dict[tuple[int, int, int], list[int]]:
        out: dict[tuple[int, int, int], list[int]] = {}
        for stream, component, step, context in self:
            out.setdefault((stream, component, step), []).append(context)
        return out


def missing_table(key: TableKey) -> Malformed:
    """The refusal of a symbol whose table was not sent."""
    return Malformed("missing-table", f"no static table for {key} (SPEC §8.3)", field="tables")
