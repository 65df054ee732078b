"""Symbols that are kept until the tables are known that code them (SPEC §8)."""

from __future__ import annotations

from collections.abc import Mapping
from ctypes import byref
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F64, I32, I64, U8, Ints
from scarfmt.entropy.emitters import Emitter, SymbolCounter, SymbolWriter, check_values, emit_groups
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.rans import code_groups
from scarfmt.entropy.symbol_tables import StaticTables, SymbolTable
from scarfmt.errors import InvalidInput
from scarfmt.native.binding import library


@dataclass(frozen=True)
class RecordedSymbols:
    """All symbols of a sub-stream.

    Attributes:
        groups: (g, 2) int64 in which they travel: the number of the key of their tables without context, or minus the
            size of their uniform alphabet; and how many they are.
        contexts: (m,) of those with static tables.
        values: (n,) integers as narrow as they allow.
        coded: the sealed stream where symbols came with their own frequencies; there are no groups then.
    """

    groups: I64
    contexts: U8
    values: NDArray[Any]
    coded: bytes

    def code(self, tables: Mapping[TableKey, SymbolTable]) -> bytes:
        """The sealed rANS stream.

        Raises:
            InvalidInput: ``input-symbol`` for a value that no table holds.
        """
        if not len(self.groups):
            return self.coded
        if library() is None:
            writer = SymbolWriter(tables)
            emit_groups(writer, self.groups, self.contexts, self.values)
            return writer.finish()
        # Their arrays live as long as they do.
        static, values = StaticTables.of(tables), self.values.astype(np.int32, copy=False)
        return code_groups(self.groups, self.contexts, values, byref(static.side_by_side))


class SymbolRecorder(Emitter):
    """An emitter that keeps what it is given.

    Args:
        counter: counts every group that needs a table.
    """

    def __init__(self, counter: SymbolCounter) -> None:
        self._counter = counter
        self._groups: list[tuple[int, int]] = []
        self._contexts: list[U8] = [np.zeros(0, np.uint8)]
        self._values: list[I32] = [np.zeros(0, np.int32)]
        self._modelled = SymbolWriter({})

    def emit(self, key: TableKey, values: Ints) -> None:
        self.emit_by_context(key, np.full(len(values), key.context, np.uint8), values)

    def emit_uniform(self, size: int, values: Ints) -> None:
        self._keep(-size, values)

    def emit_by_context(self, key: TableKey, contexts: Ints, values: Ints) -> None:
        self._keep(key.number - key.context, values)
        self._contexts.append(contexts.astype(np.uint8, copy=False))

    def _keep(self, name: int, values: Ints) -> None:
        if len(values):
            check_values(values)
            self._groups.append((name, len(values)))
            self._values.append(values.astype(np.int32, copy=False))

    def emit_rows(self, weights: F64, values: Ints) -> None:
        self._modelled.emit_rows(weights, values)

    def settle(self) -> RecordedSymbols:
        """All that was given, counted.

        Symbols that came with their own frequencies are coded: those take much memory, and wait for no table.

        Raises:
            InvalidInput: ``input-symbol`` when the stream has others, too.
        """
        coded = self._modelled.finish()
        if coded and self._groups:
            raise InvalidInput("input-symbol", "a sub-stream mixes static tables and rows", field="symbols")
        groups = np.array(self._groups, np.int64).reshape(-1, 2)
        contexts, values = np.concatenate(self._contexts), np.concatenate(self._values)
        self._counter.count(groups, contexts, values)
        return RecordedSymbols(groups, contexts, _narrow(values), coded)


def _narrow(values: I32) -> NDArray[Any]:
    """The same integers in as few bytes as they allow."""
    if not len(values):
        return values
    low, high = int(values.min()), int(values.max())
    for kind in (np.int8, np.int16):
        ends = np.iinfo(kind)
        if ends.min <= low and high <= ends.max:
            return values.astype(kind)
    return values
