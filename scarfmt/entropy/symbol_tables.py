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
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.rans import FrequencyTable
from scarfmt.native.binding import SideBySide


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

    def places(self, values: Ints) -> I64 | None:
        """(n,) places of (n,) `values` in the alphabet; None if one is not codable."""
        places = np.minimum(np.searchsorted(self.alphabet, values), len(self.alphabet) - 1)
        return places if np.array_equal(self.alphabet[places], values) else None

    def cost_of_counts(self, alphabet: I64, counts: I64) -> float:
        """Bits to code `counts` symbols of each value of `alphabet`; infinite if one is not codable."""
        places = self.places(alphabet)
        return float("inf") if places is None else float((self.table.bits[places] * counts).sum())


class StaticTables(dict[TableKey, SymbolTable]):
    """The static tables in force in a layer, by key. They do not change."""

    @classmethod
    def of(cls, tables: Mapping[TableKey, SymbolTable]) -> StaticTables:
        """`tables` themselves where they are of this class, else a copy that is."""
        return tables if isinstance(tables, StaticTables) else cls(tables)

    @cached_property
    def side_by_side(self) -> SideBySide:
        """The tables as the C library takes them; valid as long as this is."""
        keys = sorted(self)
        none = np.zeros(0, np.int64)
        values = np.concatenate([none, *(self[key].alphabet for key in keys)])
        sums = np.concatenate([none, *(self[key].table.cumulative for key in keys)])
        starts = np.cumsum([0, *(len(self[key].alphabet) for key in keys)])
        numbers = np.array([key.number for key in keys], np.int32)
        self._arrays = numbers, values.astype(np.int32), starts, sums.astype(np.uint32)
        return SideBySide(len(self), *(array.ctypes.data for array in self._arrays))
