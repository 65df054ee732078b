"""Static tables as the compiled library reads them, side by side (SPEC §8.3)."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import I64
from scarfmt.entropy.keys import CONTEXTS, StepKey, TableKey
from scarfmt.entropy.rans import PRECISION
from scarfmt.entropy.symbol_tables import StaticTables, SymbolTable
from scarfmt.kernel.structs import Tables


class PackedTables:
    """The tables of some kinds of symbols, side by side.

    Args:
        tables: by (component's place, context).
        components: how many there are.
    """

    def __init__(self, tables: Mapping[tuple[int, int], SymbolTable], components: int) -> None:
        entries = list(tables.values())
        sizes = np.array([len(entry.alphabet) for entry in entries], np.int64)
        self._starts = np.concatenate(([0], np.cumsum(sizes)))
        weights = np.concatenate([entry.weights for entry in entries]) if entries else np.zeros(0, np.int64)
        alphabet = np.concatenate([entry.alphabet for entry in entries]) if entries else weights
        self._values = alphabet.astype(np.int32)
        self._sums = _prefix_sums(weights, sizes, self._starts)
        self._number = np.full(components * CONTEXTS, -1, np.int32)
        for number, (place, context) in enumerate(tables):
            self._number[place * CONTEXTS + context] = number
        self._few = _few_symbols(self._number, self._starts, self._sums, self._values)
        self._used = np.zeros(len(self._number), np.uint8)
        arrays = (self._number, self._starts, self._sums, self._values, self._few, self._used)
        self.pointer = ctypes.pointer(Tables(len(self._number), *(array.ctypes.data for array in arrays)))

    @property
    def kinds(self) -> int:
        """Kinds that may occur."""
        return len(self._number)

    @property
    def used(self) -> I64:
        """Kinds of which a symbol was read, ascending."""
        return np.flatnonzero(self._used)


class PackedSteps:
    """The tables of consecutive steps of a channel."""

    def __init__(self, steps: Sequence[PackedTables]) -> None:
        self._kept = steps
        self.array = (ctypes.c_void_p * len(steps))(*(ctypes.addressof(tables.pointer.contents) for tables in steps))


def _prefix_sums(weights: I64, sizes: I64, starts: I64) -> NDArray[np.uint32]:
    """Cumulative frequencies of all tables (SPEC §8.1), each with its 2^24 at the end."""
    running = np.concatenate(([0], np.cumsum(weights)))
    base = running[starts]
    table = np.repeat(np.arange(len(sizes)), sizes + 1)
    place = np.arange(len(table)) - (starts[table] + table)
    prefix = running[starts[table] + place] - base[table]
    scaled = prefix * ((1 << PRECISION) - sizes[table]) // np.diff(base)[table]
    return np.asarray(scaled + place, np.uint32)


def _few_symbols(
    number: NDArray[np.int32], starts: I64, sums: NDArray[np.uint32], values: NDArray[np.int32]
) -> NDArray[np.int32]:
    """(kinds, 8) fields of FewSymbols, zeros where a kind has no table or one of more than three symbols."""
    sizes = np.diff(starts)
    few = np.zeros((len(sizes) + 1, 8), np.int32)
    chosen = np.flatnonzero(sizes <= 3)
    first, size, last = starts[chosen], sizes[chosen], starts[chosen + 1] - 1
    padded = np.concatenate([sums, np.zeros(2, np.uint32)]).astype(np.int64)
    second = np.where(size > 1, padded[first + chosen + 1], 1 << PRECISION)
    third = np.where(size > 2, padded[first + chosen + 2], 1 << PRECISION)
    apart = third - second
    fields = second, third, apart, apart - second, (1 << PRECISION) - third - apart
    few[chosen] = np.stack([*fields, values[first], values[np.minimum(first + 1, last)], values[last]], axis=1)
    # Kinds without a table have the number -1, and so the last row.
    return few[number]


class PackedStaticTables:
    """The static tables in force in a layer, packed step by step when they are first asked for.

    Threads may share them. To be kept with the tables: :meth:`scarfmt.kept.Keeper.kept`.
    """

    def __init__(self, tables: StaticTables) -> None:
        self._tables = tables
        self._packed: dict[StepKey, PackedTables] = {}
        self._steps: dict[tuple[int, int, range], PackedSteps] = {}

    def step(self, key: StepKey) -> PackedTables:
        """The tables of one step of some components."""
        if key not in self._packed:
            found = {}
            for place, component in enumerate(key.components):
                for context in self._tables.contexts(key.stream, component, key.step):
                    found[place, context] = self._tables[TableKey(key.stream, component, key.step, context)]
            self._packed[key] = PackedTables(found, len(key.components))
        return self._packed[key]

    def steps(self, stream: int, components: int, steps: range) -> PackedSteps:
        """Packed tables of some steps of all components of a channel."""
        key = (stream, components, steps)
        if key not in self._steps:
            every = tuple(range(components))
            self._steps[key] = PackedSteps([self.step(StepKey(stream, every, step)) for step in steps])
        return self._steps[key]

    @property
    def used(self) -> set[TableKey]:
        """Keys of the tables that a symbol was read with."""
        return {key.table(kind) for key, tables in self._packed.items() for kind in tables.used.tolist()}
