"""Emitters: where a codec's groups of symbols go when a file is written (SPEC §8).

A group is a run of values that share one static table, named by a :class:`TableKey`. The encoder runs each codec over
one interface: with a :class:`SymbolCounter` to learn the tables, with a :class:`SymbolWriter` to code, or with a
:class:`SymbolRecorder` for both in one run.
"""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from scarfmt.arrays import F32, F64, I64, Ints
from scarfmt.entropy.grouping import by_context
from scarfmt.entropy.keys import StepKey, TableKey
from scarfmt.entropy.rans import PRECISION, RansEncoder, SymbolSink, cached_uniform
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.errors import InvalidInput


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

    def emit_by_context(self, key: TableKey, contexts: I64, values: Ints) -> None:
        """(n,) `values` of one component grouped by (n,) ascending context (0..255), order kept within each group.

        Args:
            key: the tables' key; its context is replaced.
        """
        self.emit_grouped(StepKey(key.stream, (key.component,), key.step), contexts, values)

    def emit_logits(self, logits: F32 | None, weights: Callable[[], F64], values: Ints) -> None:
        """(n,) `values` by (k, n) integer `logits` or by the rows that `weights` makes of them.

        Args:
            logits: None where something else than NumPy's float32 holds them.
            weights: gives the rows of :meth:`emit_rows`; to be asked for once, as it uses up the logits.
        """
        self.emit_rows(weights(), values)


class SymbolCounter(Emitter):
    """An emitter that only counts, per table key."""

    def __init__(self) -> None:
        self._values: dict[TableKey, list[Ints]] = {}
        # Per step: (m,) joint numbers of kind and value, and how often each came.
        self._joint: dict[StepKey, list[tuple[I64, I64]]] = {}
        self.uniform_bits = 0.0
        self.modelled_bits = 0.0

    def emit(self, key: TableKey, values: Ints) -> None:
        if len(values):
            self._values.setdefault(key, []).append(values)

    def emit_grouped(self, key: StepKey, kinds: Ints, values: Ints) -> None:
        if len(values):
            self._joint.setdefault(key, []).append(_joint_counts(kinds, values))

    def emit_uniform(self, size: int, values: Ints) -> None:
        self.uniform_bits += len(values) * float(np.log2(size))

    def emit_rows(self, weights: F64, values: Ints) -> None:
        frequencies = weights[np.arange(len(values)), values] + 1
        self.modelled_bits += float((PRECISION - np.log2(frequencies)).sum())

    def histograms(self) -> dict[TableKey, tuple[I64, I64]]:
        """(alphabet, counts) per key, keys ascending."""
        found: dict[TableKey, list[tuple[I64, I64]]] = {}
        for key, groups in self._values.items():
            alphabet, counts = np.unique(np.concatenate(groups), return_counts=True)
            found[key] = [(alphabet.astype(np.int64), counts)]
        for step, parts in self._joint.items():
            joint, counts = _added([part[0] for part in parts], [part[1] for part in parts])
            kinds = joint >> _VALUE_BITS
            starts = np.flatnonzero(np.diff(kinds, prepend=-1)).tolist()
            for first, past in itertools.pairwise([*starts, len(kinds)]):
                values = (joint[first:past] & _VALUE_MASK) - _VALUE_ZERO
                found.setdefault(step.table(int(kinds[first])), []).append((values, counts[first:past]))
        return {key: _added(*zip(*parts, strict=True)) for key, parts in sorted(found.items())}


# A joint number is kind * 2^33 + value + 2^32.
_VALUE_BITS = 33
_VALUE_ZERO = 1 << 32
_VALUE_MASK = (1 << _VALUE_BITS) - 1
# So many cells are counted without sorting.
_DENSE = 1 << 16


def _joint_counts(kinds: Ints, values: Ints) -> tuple[I64, I64]:
    """Joint numbers of kind and value that occur, ascending, and how often.

    Raises:
        InvalidInput: ``input-symbol`` for a value beyond 32 bits.
    """
    low, high = int(values.min()), int(values.max())
    if low < -(1 << 31) or high >= 1 << 31:
        raise InvalidInput("input-symbol", "a value beyond 32 bits", field="symbols")
    wide = high - low + 1
    if (int(kinds.max()) + 1) * wide <= _DENSE:
        counts = np.bincount(kinds.astype(np.int64) * wide + values - low)
        cells = np.flatnonzero(counts)
        return ((cells // wide) << _VALUE_BITS) + cells % wide + low + _VALUE_ZERO, counts[cells]
    joint = (kinds.astype(np.int64) << _VALUE_BITS) + values + _VALUE_ZERO
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
        sink: codes in place of :class:`RansEncoder`.
    """

    def __init__(self, tables: Mapping[TableKey, SymbolTable], sink: SymbolSink | None = None) -> None:
        self._tables = tables
        self._rans = RansEncoder() if sink is None else sink

    def emit(self, key: TableKey, values: Ints) -> None:
        if len(values):
            entry = self._tables[key]
            self._rans.encode(np.searchsorted(entry.alphabet, values), entry.table)

    def emit_uniform(self, size: int, values: Ints) -> None:
        self._rans.encode(values, cached_uniform(size))

    def emit_rows(self, weights: F64, values: Ints) -> None:
        self._rans.encode_rows(values, weights)

    def finish(self) -> bytes:
        """The sealed rANS stream."""
        return self._rans.finish()


OpenWriter = Callable[[Mapping[TableKey, SymbolTable]], SymbolWriter]
"""Gives a writer of a sub-stream under static tables."""


class SymbolRecorder(Emitter):
    """An emitter that keeps what it is given, to be coded once the tables are known.

    Args:
        counter: counts every group that needs a table.
        open_writer: gives the writers that code.
    """

    def __init__(self, counter: SymbolCounter, open_writer: OpenWriter = SymbolWriter) -> None:
        self._counter, self._open = counter, open_writer
        self._groups: list[tuple[TableKey | int, Ints] | tuple[StepKey, Ints, Ints]] = []
        self._modelled = open_writer({})
        self._coded = b""

    def emit(self, key: TableKey, values: Ints) -> None:
        self._counter.emit(key, values)
        self._groups.append((key, values))

    def emit_uniform(self, size: int, values: Ints) -> None:
        self._groups.append((size, values))

    def emit_grouped(self, key: StepKey, kinds: Ints, values: Ints) -> None:
        if len(values):
            self._counter.emit_grouped(key, kinds, values)
            self._groups.append((key, kinds.astype(np.uint16), values.astype(np.int32)))

    def emit_rows(self, weights: F64, values: Ints) -> None:
        self._modelled.emit_rows(weights, values)

    def emit_logits(self, logits: F32 | None, weights: Callable[[], F64], values: Ints) -> None:
        self._modelled.emit_logits(logits, weights, values)

    def settle(self) -> None:
        """Code symbols that came with their own frequencies: those take much memory, and wait for no table.

        Raises:
            InvalidInput: ``input-symbol`` when the stream has others, too.
        """
        self._coded, self._modelled = self._modelled.finish(), self._open({})
        if self._coded and self._groups:
            raise InvalidInput("input-symbol", "a sub-stream mixes static tables and rows", field="symbols")

    def code(self, tables: Mapping[TableKey, SymbolTable]) -> bytes:
        """The sealed rANS stream."""
        writer = self._open(tables)
        for key, *arrays in self._groups:
            if isinstance(key, StepKey):
                writer.emit_grouped(key, *arrays)
            elif isinstance(key, TableKey):
                writer.emit(key, *arrays)
            else:
                writer.emit_uniform(key, *arrays)
        return self._coded or writer.finish()
