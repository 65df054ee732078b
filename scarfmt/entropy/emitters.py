"""Emitters: where a codec's groups of symbols go when a file is written (SPEC §8).

A group is a run of values that share one static table, named by a :class:`TableKey`. The encoder runs each codec over
one interface: with a :class:`SymbolCounter` to learn the tables, with a :class:`SymbolWriter` to code, or with a
:class:`scarfmt.entropy.recorded.SymbolRecorder` for both in one run.
"""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F64, I32, I64, U16, Ints
from scarfmt.entropy.grouping import by_context
from scarfmt.entropy.keys import StepKey, TableKey
from scarfmt.entropy.rans import PRECISION, RansEncoder, cached_uniform
from scarfmt.entropy.symbol_tables import JOINT_BITS, JOINT_ZERO, StaticTables, SymbolTable
from scarfmt.errors import InvalidInput

Group = tuple[StepKey | int, int]
"""Symbols side by side: what names their static tables, or the size of their uniform alphabet; how many they are."""


class Emitter(ABC):
    """Takes groups of symbols in decoding order."""

    @abstractmethod
    def emit(self, key: TableKey, values: Ints) -> None:
        """(n,) `values` that share a static table."""

    @abstractmethod
    def emit_uniform(self, size: int, values: Ints) -> None:
        """(n,) `values` of a uniform alphabet 0..size-1."""

    @abstractmethod
    def emit_rows(self, weights: F64, values: Ints) -> None:
        """(n,) `values`, each with its own row of (n, k) `weights`: f - 1 (SPEC §10.5)."""

    def emit_grouped(self, key: StepKey, kinds: Ints, values: Ints) -> None:
        """(n,) `values` with their (n,) kinds (see :class:`StepKey`), order kept within each group (SPEC §8.4)."""
        order, runs = by_context(kinds)
        arranged = values[order]
        for kind, start, past in runs:
            self.emit(key.table(kind), arranged[start:past])

    def emit_groups(self, groups: Sequence[Group], kinds: U16, values: Ints) -> None:
        """Several groups, one after the other.

        Args:
            kinds: of the symbols that have static tables, those of all groups in their order.
            values: of all symbols.
        """
        start = place = 0
        for name, count in groups:
            part = values[start : start + count]
            start += count
            if isinstance(name, int):
                self.emit_uniform(name, part)
            else:
                self.emit_grouped(name, kinds[place : place + count], part)
                place += count

    def emit_by_context(self, key: TableKey, contexts: I64, values: Ints) -> None:
        """(n,) `values` of one component grouped by (n,) ascending context (0..255), order kept within each group.

        Args:
            key: the tables' key; its context is replaced.
        """
        self.emit_grouped(StepKey(key.stream, (key.component,), key.step), contexts, values)


class SymbolCounter(Emitter):
    """An emitter that only counts, per table key. What it is given must not be changed afterwards."""

    def __init__(self) -> None:
        self._values: dict[TableKey, list[Ints]] = {}
        self._pools: dict[StepKey, _Pool] = {}
        self.uniform_bits = 0.0
        self.modelled_bits = 0.0

    def emit(self, key: TableKey, values: Ints) -> None:
        if len(values):
            self._values.setdefault(key, []).append(values)

    def emit_grouped(self, key: StepKey, kinds: Ints, values: Ints) -> None:
        if len(values):
            check_values(values)
            if key not in self._pools:
                self._pools[key] = _Pool()
            self._pools[key].add(kinds, values)

    def emit_uniform(self, size: int, values: Ints) -> None:
        self.uniform_bits += len(values) * math.log2(size)

    def emit_rows(self, weights: F64, values: Ints) -> None:
        frequencies = weights[np.arange(len(values)), values] + 1
        self.modelled_bits += float((PRECISION - np.log2(frequencies)).sum())

    def histograms(self) -> dict[TableKey, tuple[I64, I64]]:
        """(alphabet, counts) per key, keys ascending."""
        found: dict[TableKey, list[tuple[I64, I64]]] = {}
        for key, groups in self._values.items():
            alphabet, counts = np.unique(np.concatenate(groups), return_counts=True)
            found[key] = [(alphabet.astype(np.int64), counts)]
        for step, pool in self._pools.items():
            joint, counts = pool.counted()
            kinds = joint >> JOINT_BITS
            starts = np.flatnonzero(np.diff(kinds, prepend=-1)).tolist()
            for first, past in itertools.pairwise([*starts, len(kinds)]):
                values = (joint[first:past] & _VALUE_MASK) - JOINT_ZERO
                found.setdefault(step.table(int(kinds[first])), []).append((values, counts[first:past]))
        return {key: _added(*zip(*parts, strict=True)) for key, parts in sorted(found.items())}


_VALUE_MASK = (1 << JOINT_BITS) - 1
# So many symbols of a step wait to be counted together: one by one, small groups take longer to look at than to count.
_POOLED = 1 << 19
# So many cells are counted without sorting, or so many times as there are symbols.
_DENSE, _CELLS_EACH = 1 << 16, 8
# Values beyond are few, and counted apart.
_NEAR = 1 << 11


class _Pool:
    """Symbols of one step that are counted many at once."""

    def __init__(self) -> None:
        self._kinds: list[Ints] = []
        self._values: list[Ints] = []
        self._waiting = 0
        self._found: list[tuple[I64, I64]] = []

    def add(self, kinds: Ints, values: Ints) -> None:
        self._kinds.append(kinds)
        self._values.append(values)
        self._waiting += len(values)
        if self._waiting >= _POOLED:
            self._count()

    def _count(self) -> None:
        values = np.concatenate(self._values).astype(np.int32, copy=False)
        self._found.append(_joint_counts(np.concatenate(self._kinds), values))
        self._kinds, self._values, self._waiting = [], [], 0

    def counted(self) -> tuple[I64, I64]:
        """Joint numbers of kind and value that occur, ascending, and how often."""
        if self._waiting:
            self._count()
        return _added(*zip(*self._found, strict=True))


def check_values(values: Ints) -> None:
    """Check that symbols, at least one, are of 32 bits.

    Raises:
        InvalidInput: ``input-symbol``.
    """
    if values.dtype.itemsize > 4 and (int(values.min()) < -(1 << 31) or int(values.max()) >= 1 << 31):
        raise InvalidInput("input-symbol", "a value beyond 32 bits", field="symbols")


def _joint_counts(kinds: Ints, values: I32) -> tuple[I64, I64]:
    """Joint numbers of kind and value that occur, ascending, and how often."""
    low, high = int(values.min()), int(values.max())
    wide = high - low + 1
    dense = (int(kinds.max()) + 1) * wide
    if dense <= max(_DENSE, _CELLS_EACH * len(values)):
        short: type[np.integer[Any]] = np.uint16 if dense < _DENSE else np.int64
        places: NDArray[Any] = kinds.astype(short)
        places *= wide
        places += (values - low).astype(short)
        counts = np.bincount(places)
        cells = np.flatnonzero(counts)
        return ((cells // wide) << JOINT_BITS) + cells % wide + low + JOINT_ZERO, counts[cells]
    near = (values >= -_NEAR) & (values < _NEAR)
    if near.any() and not near.all():
        parts = [_joint_counts(kinds[here], values[here]) for here in (near, ~near)]
        return _added(*zip(*parts, strict=True))
    joint = (kinds.astype(np.int64) << JOINT_BITS) + values + JOINT_ZERO
    found, counts = np.unique(joint, return_counts=True)
    return found, counts


def _added(numbers: Sequence[I64], counts: Sequence[I64]) -> tuple[I64, I64]:
    """Numbers that occur in any of several lists, ascending, and their counts added up."""
    if len(numbers) == 1:
        return numbers[0], counts[0]
    found, place = np.unique(np.concatenate(numbers), return_inverse=True)
    total = np.zeros(len(found), np.int64)
    np.add.at(total, place, np.concatenate(counts))
    return found, total


class SymbolWriter(Emitter):
    """An emitter that codes one sub-stream.

    Args:
        tables: static tables in force.
    """

    def __init__(self, tables: Mapping[TableKey, SymbolTable]) -> None:
        self._tables = StaticTables.of(tables)
        self._rans = RansEncoder()

    def emit(self, key: TableKey, values: Ints) -> None:
        if len(values):
            entry = self._tables[key]
            self._rans.encode(np.searchsorted(entry.alphabet, values), entry.table)

    def emit_grouped(self, key: StepKey, kinds: Ints, values: Ints) -> None:
        self.emit_groups([(key, len(values))], kinds.astype(np.uint16, copy=False), values)

    def emit_groups(self, groups: Sequence[Group], kinds: U16, values: Ints) -> None:
        if not len(values):
            return
        sizes = np.array([count for _, count in groups])
        named = np.array([not isinstance(name, int) for name, _ in groups])
        spans = np.empty((2, len(values)), np.uint32)
        static = np.repeat(named, sizes)
        if len(kinds):
            steps = [(name, count) for name, count in groups if not isinstance(name, int)]
            spans[:, static] = self._static_spans(steps, kinds, values[static])
        for (name, count), past in zip(groups, np.cumsum(sizes).tolist(), strict=True):
            if isinstance(name, int):
                part = slice(past - count, past)
                spans[:, part] = cached_uniform(name).spans(values[part])
        self._rans.append(*spans)

    def _static_spans(self, groups: Sequence[tuple[StepKey, int]], kinds: U16, values: Ints) -> tuple[I64, I64]:
        """(n,) first slots of symbols of one stream that have static tables, and those past the last."""
        sizes = [count for _, count in groups]
        numbers = {step: number for number, step in enumerate(dict.fromkeys(step for step, _ in groups))}
        order = np.argsort(kinds, kind="stable")
        group = np.repeat(np.arange(len(groups)), sizes)[order]
        # Numbers of 16 bits are sorted by counting.
        order = order[np.argsort(group.astype(np.uint16) if len(groups) <= 1 << 16 else group, kind="stable")]
        which = np.repeat([numbers[step] for step, _ in groups], sizes)
        tables = self._tables.stream(groups[0][0].stream)
        return tables.spans(list(numbers), which, kinds[order], values[order])

    def emit_uniform(self, size: int, values: Ints) -> None:
        self._rans.encode(values, cached_uniform(size))

    def emit_rows(self, weights: F64, values: Ints) -> None:
        self._rans.encode_rows(values, weights)

    def finish(self) -> bytes:
        """The sealed rANS stream."""
        return self._rans.finish()
