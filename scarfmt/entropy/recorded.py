"""Symbols that are kept until the tables are known that code them (SPEC §8)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F64, I32, U16, Ints
from scarfmt.entropy.emitters import Emitter, Group, SymbolCounter, SymbolWriter, check_values
from scarfmt.entropy.keys import StepKey, TableKey
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.errors import InvalidInput


@dataclass(frozen=True)
class RecordedSymbols:
    """All symbols of a sub-stream.

    Attributes:
        groups: in which they travel.
        kinds: (m,) of those with static tables.
        values: (n,) integers as narrow as they allow.
        coded: the sealed stream where symbols came with their own frequencies; there are no groups then.
    """

    groups: tuple[Group, ...]
    kinds: U16
    values: NDArray[Any]
    coded: bytes

    def code(self, tables: Mapping[TableKey, SymbolTable]) -> bytes:
        """The sealed rANS stream."""
        if not self.groups:
            return self.coded
        writer = SymbolWriter(tables)
        writer.emit_groups(self.groups, self.kinds, self.values)
        return writer.finish()


class SymbolRecorder(Emitter):
    """An emitter that keeps what it is given.

    Args:
        counter: counts every group that needs a table.
    """

    def __init__(self, counter: SymbolCounter) -> None:
        self._counter = counter
        self._groups: list[Group] = []
        self._kinds: list[U16] = []
        self._values: list[I32] = []
        self._modelled = SymbolWriter({})

    def emit(self, key: TableKey, values: Ints) -> None:
        if len(values):
            check_values(values)
            self._counter.emit(key, values)
            step = StepKey(key.stream, (key.component,), key.step)
            self._keep((step, len(values)), np.full(len(values), key.context, np.uint16), values)

    def emit_uniform(self, size: int, values: Ints) -> None:
        if len(values):
            self._keep((size, len(values)), np.zeros(0, np.uint16), values)

    def emit_grouped(self, key: StepKey, kinds: Ints, values: Ints) -> None:
        if len(values):
            self._counter.emit_grouped(key, kinds, values)
            self._keep((key, len(values)), kinds, values)

    def emit_groups(self, groups: Sequence[Group], kinds: U16, values: Ints) -> None:
        if len(values):
            self._counter.emit_groups(groups, kinds, values)
            self._groups += groups
            self._kinds.append(kinds)
            self._values.append(values.astype(np.int32, copy=False))

    def _keep(self, group: Group, kinds: Ints, values: Ints) -> None:
        self._groups.append(group)
        self._kinds.append(kinds.astype(np.uint16, copy=False))
        self._values.append(values.astype(np.int32, copy=False))

    def emit_rows(self, weights: F64, values: Ints) -> None:
        self._modelled.emit_rows(weights, values)

    def settled(self) -> RecordedSymbols:
        """All that was given.

        Symbols that came with their own frequencies are coded: those take much memory, and wait for no table.

        Raises:
            InvalidInput: ``input-symbol`` when the stream has others, too.
        """
        coded = self._modelled.finish()
        if coded and self._groups:
            raise InvalidInput("input-symbol", "a sub-stream mixes static tables and rows", field="symbols")
        kinds = np.concatenate([np.zeros(0, np.uint16), *self._kinds])
        return RecordedSymbols(tuple(self._groups), kinds, _narrow(np.concatenate([_NONE, *self._values])), coded)


_NONE = np.zeros(0, np.int32)


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
