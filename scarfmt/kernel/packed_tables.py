"""Static tables as the compiled library reads them, side by side (SPEC §8.3)."""

from __future__ import annotations

import ctypes
from collections.abc import Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import I64
from scarfmt.entropy.keys import CONTEXTS, StepKey, TableKey
from scarfmt.entropy.rans import PRECISION
from scarfmt.entropy.symbol_tables import StaticTables, SymbolTable
from scarfmt.kernel.structs import Tables

_COMPONENTS = 256
"""Components that a key can name."""


class TableArrays:
    """The numbers of some tables, side by side.

    Args:
        tables: any number of them.

    Attributes:
        starts: (n + 1,) int64 where each table's values begin, and where the last one's end.
        values: int32 alphabets, one after the other.
        sums: uint32 cumulative frequencies, each table's with its 2^24 at the end.
        few: (n + 1, 8) int32 fields of FewSymbols; zeros for a table of more than three symbols, and in the last row.
    """

    def __init__(self, tables: Collection[SymbolTable]) -> None:
        sizes = np.array([len(table.alphabet) for table in tables], np.int64)
        none = [np.zeros(0, np.int64)]
        self.starts = np.concatenate(([0], np.cumsum(sizes)))
        self.values = np.concatenate(none + [table.alphabet for table in tables]).astype(np.int32)
        self.sums = _prefix_sums(np.concatenate(none + [table.weights for table in tables]), sizes, self.starts)
        self.few = _few_symbols(self.starts, self.sums, self.values)


class PackedTables:
    """The tables of some kinds of symbols.

    Args:
        tables: by (component's place, context).
        components: how many there are.
    """

    def __init__(self, tables: Mapping[tuple[int, int], SymbolTable], components: int) -> None:
        kinds = np.array([place * CONTEXTS + context for place, context in tables], np.int64)
        self._take(TableArrays(tables.values()), kinds, np.arange(len(kinds)), components)

    @classmethod
    def of(cls, arrays: TableArrays, kinds: I64, numbers: I64, components: int) -> PackedTables:
        """Some of the tables of `arrays`: (n,) their kinds and (n,) their numbers there."""
        made = cls.__new__(cls)
        made._take(arrays, kinds, numbers, components)
        return made

    def _take(self, arrays: TableArrays, kinds: I64, numbers: I64, components: int) -> None:
        self._arrays = arrays
        self._number = np.full(components * CONTEXTS, -1, np.int32)
        self._number[kinds] = numbers
        # Kinds without a table have the number -1, and so the last row.
        self._few = arrays.few[self._number]
        self._used = np.zeros(len(self._number), np.uint8)
        held = (self._number, arrays.starts, arrays.sums, arrays.values, self._few, self._used)
        self.pointer = ctypes.pointer(Tables(len(self._number), *(array.ctypes.data for array in held)))

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


def _few_symbols(starts: I64, sums: NDArray[np.uint32], values: NDArray[np.int32]) -> NDArray[np.int32]:
    """(tables + 1, 8) fields of FewSymbols: of :class:`TableArrays`."""
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
    return few


class PackedStaticTables:
    """The static tables in force in a layer, packed step by step when they are first asked for.

    Threads may share them. To be kept with the tables: :meth:`scarfmt.kept.Keeper.kept`.
    """

    def __init__(self, tables: StaticTables) -> None:
        # Not the tables themselves: they keep this, and what holds itself is in memory until the collector comes.
        self._arrays = TableArrays(tables.values())
        """The arrays of all tables: packing some of them at a time would take longer."""
        self._places = _places(tables)
        self._packed: dict[StepKey, PackedTables] = {}
        self._steps: dict[tuple[int, int, range], PackedSteps] = {}

    def step(self, key: StepKey) -> PackedTables:
        """The tables of one step of some components."""
        if key not in self._packed:
            none = np.zeros(0, np.int64)
            component, context, number = self._places.get((key.stream, key.step), (none, none, none))
            place = np.full(_COMPONENTS, -1)
            place[list(key.components)] = np.arange(len(key.components))
            chosen = np.flatnonzero(place[component] >= 0)
            kinds = place[component[chosen]] * CONTEXTS + context[chosen]
            # The first that any thread has packed stays: others have its address, and it knows what was read.
            packed = PackedTables.of(self._arrays, kinds, number[chosen], len(key.components))
            self._packed.setdefault(key, packed)
        return self._packed[key]

    def steps(self, stream: int, components: int, steps: range) -> PackedSteps:
        """Packed tables of some steps of all components of a channel."""
        key = (stream, components, steps)
        if key not in self._steps:
            every = tuple(range(components))
            self._steps.setdefault(key, PackedSteps([self.step(StepKey(stream, every, step)) for step in steps]))
        return self._steps[key]

    @property
    def used(self) -> set[TableKey]:
        """Keys of the tables that a symbol was read with."""
        return {key.table(kind) for key, tables in self._packed.items() for kind in tables.used.tolist()}


def _places(tables: StaticTables) -> dict[tuple[int, int], tuple[I64, I64, I64]]:
    """By stream and step: component, context and number of the tables."""
    found: dict[tuple[int, int], list[tuple[int, int, int]]] = {}
    for number, (stream, component, step, context) in enumerate(tables):
        found.setdefault((stream, step), []).append((component, context, number))
    return {key: tuple(np.array(rows, np.int64).T) for key, rows in found.items()}
