"""Emitters: where a codec's groups of symbols go when a file is written (SPEC §8).

A group is a run of values that share one static table, named by a :class:`TableKey`. The encoder runs each codec over
one interface: with a :class:`SymbolCounter` to learn the tables, with a :class:`SymbolWriter` to code, or with a
:class:`scarfmt.entropy.recorded.SymbolRecorder` for both in one run.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from ctypes import byref, c_int64
from itertools import pairwise

import numpy as np

from scarfmt.arrays import F64, I32, I64, U8, Ints
from scarfmt.entropy.grouping import by_context
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.rans import RansEncoder, make_uniform, symbol_refusal
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.errors import InvalidInput
from scarfmt.native.binding import library


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

    def emit_by_context(self, key: TableKey, contexts: Ints, values: Ints) -> None:
        """(n,) `values` grouped by (n,) ascending context (0..255), order kept within each group (SPEC §8.4).

        Args:
            key: the tables' key; its context is replaced.
        """
        order, runs = by_context(contexts)
        arranged = values[order]
        for context, start, past in runs:
            self.emit(key._replace(context=context), arranged[start:past])


def emit_groups(emitter: Emitter, groups: I64, contexts: U8, values: Ints) -> None:
    """Emit groups as :class:`scarfmt.entropy.recorded.RecordedSymbols` has them."""
    start = place = 0
    for name, count in groups.tolist():
        part = values[start : start + count]
        start += count
        if name < 0:
            emitter.emit_uniform(-name, part)
        else:
            emitter.emit_by_context(TableKey.from_number(name), contexts[place : place + count], part)
            place += count


_ROOM, _ROOM_EACH = 1 << 17, 4
"""Different symbols that are counted together, and least room beside the symbols of a group."""


class SymbolCounter(Emitter):
    """An emitter that only counts, per table key. What it is given must not be changed afterwards."""

    def __init__(self) -> None:
        self._found: dict[TableKey, list[tuple[I64, I64]]] = {}
        self._waiting: dict[TableKey, list[Ints]] = {}
        self._cells, self._used = np.zeros((0, 2), np.int64), c_int64(0)
        self.uniform_bits = 0.0

    def emit(self, key: TableKey, values: Ints) -> None:
        if len(values):
            check_values(values)
            self._waiting.setdefault(key, []).append(values)

    def emit_uniform(self, size: int, values: Ints) -> None:
        self.uniform_bits += len(values) * math.log2(size)

    def emit_rows(self, weights: F64, values: Ints) -> None:
        """Rows need no table: there is nothing to count."""

    def count(self, groups: I64, contexts: U8, values: I32) -> None:
        """Count the symbols of groups, as :func:`emit_groups` would."""
        native = library()
        if native is None:
            emit_groups(self, groups, contexts, values)
            return
        ends, symbols = (c_int64 * 2)(), (contexts.ctypes.data, values.ctypes.data)
        while len(groups):
            here, room = groups.ctypes.data, len(self._cells)
            counted = native.scar_count(
                here, len(groups), *symbols, self._cells.ctypes.data, room, byref(self._used), ends
            )
            groups = groups[counted:]
            if len(groups):
                self._settle(max(_ROOM, 1 << (_ROOM_EACH * int(groups[:, 1].max())).bit_length()))

    def _settle(self, room: int) -> None:
        """Make histograms of what the C library counted, and room for more."""
        cells = self._cells[self._cells[:, 0] != 0]
        symbols, counts = cells[np.argsort(cells[:, 0])].T
        keys, alphabet = symbols >> 32, (symbols & 0xFFFFFFFF) - (1 << 31)
        for first, past in pairwise([*np.flatnonzero(np.diff(keys, prepend=-1)).tolist(), len(keys)]):
            found = alphabet[first:past], counts[first:past]
            self._found.setdefault(TableKey.from_number(int(keys[first])), []).append(found)
        self._cells, self._used = np.zeros((room, 2), np.int64), c_int64(0)

    def histograms(self) -> dict[TableKey, tuple[I64, I64]]:
        """(alphabet, counts) per key, keys ascending."""
        self._settle(0)
        for key, groups in self._waiting.items():
            alphabet, counts = np.unique(np.concatenate(groups), return_counts=True)
            self._found.setdefault(key, []).append((alphabet.astype(np.int64), counts))
        self._waiting = {}
        return {key: _add(*zip(*parts, strict=True)) for key, parts in sorted(self._found.items())}


def check_values(values: Ints) -> None:
    """Check that symbols, at least one, are of 32 bits.

    Raises:
        InvalidInput: ``input-symbol``.
    """
    if values.dtype.itemsize > 4 and (int(values.min()) < -(1 << 31) or int(values.max()) >= 1 << 31):
        raise InvalidInput("input-symbol", "a value beyond 32 bits", field="symbols")


def _add(numbers: Sequence[I64], counts: Sequence[I64]) -> tuple[I64, I64]:
    """Numbers that occur in any of several lists, ascending, and their counts added up."""
    if len(numbers) == 1:
        return numbers[0], counts[0]
    found, place = np.unique(np.concatenate(numbers), return_inverse=True)
    total = np.zeros(len(found), np.int64)
    np.add.at(total, place, np.concatenate(counts))
    return found, total


class SymbolWriter(Emitter):
    """An emitter that codes one sub-stream."""

    def __init__(self, tables: Mapping[TableKey, SymbolTable]) -> None:
        self._tables = tables
        self._rans = RansEncoder()

    def emit(self, key: TableKey, values: Ints) -> None:
        if not len(values):
            return
        places = self._tables[key].places(values) if key in self._tables else None
        if places is None:
            raise symbol_refusal()
        self._rans.encode(places, self._tables[key].table)

    def emit_uniform(self, size: int, values: Ints) -> None:
        self._rans.encode(values, make_uniform(size))

    def emit_rows(self, weights: F64, values: Ints) -> None:
        self._rans.encode_rows(values, weights)

    def finish(self) -> bytes:
        """The sealed rANS stream."""
        return self._rans.finish()
