"""Reading a sub-stream, group by group (SPEC §8).

A group is a run of values that share one table.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from scarfmt.arrays import F64, I32, I64, Ints
from scarfmt.entropy.grouping import by_context
from scarfmt.entropy.keys import StepKey, TableKey
from scarfmt.entropy.rans import RansDecoder, make_uniform
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.errors import Malformed


class SymbolReader:
    """Reads one sub-stream, group by group."""

    def __init__(self, data: bytes, tables: Mapping[TableKey, SymbolTable]) -> None:
        self._tables = tables
        self._rans = RansDecoder(data)

    def read(self, key: TableKey, count: int) -> I64:
        """The next `count` values, (count,) int64.

        Raises:
            Malformed: ``missing-table`` when no TABLES block so far holds `key`.
        """
        if not count:
            return np.zeros(0, np.int64)
        entry = self._tables.get(key)
        if entry is None:
            raise Malformed("missing-table", f"no static table for {key} (SPEC §8.3)", field="tables")
        if len(entry.alphabet) == 1:
            return np.repeat(entry.alphabet, count)
        return entry.alphabet.take(self._rans.decode(entry.table, count))

    def read_grouped(self, key: StepKey, kinds: Ints) -> I32:
        """The next values, (n,) int32, grouped by ascending kind, order kept within each group (SPEC §8.4).

        Args:
            kinds: (n,) what :class:`StepKey` says, below 2^14.

        Raises:
            Malformed: ``missing-table``.
        """
        out = np.empty(len(kinds), np.int32)
        arranged = np.empty(len(kinds), np.int32)
        order, runs = by_context(kinds)
        for kind, start, past in runs:
            arranged[start:past] = self.read(key.table(kind), past - start)
        out[order] = arranged
        return out

    def read_by_context(self, key: TableKey, contexts: I64) -> I32:
        """The next values, (n,) int32, of one component, grouped by ascending context (0..255).

        Args:
            key: the tables' key; its context is replaced.
            contexts: (n,).

        Raises:
            Malformed: ``missing-table``.
        """
        return self.read_grouped(StepKey(key.stream, (key.component,), key.step), contexts)

    def read_uniform(self, size: int, count: int) -> I64:
        """The next `count` values of a uniform alphabet 0..size-1."""
        return self._rans.decode(make_uniform(size), count).astype(np.int64)

    def read_rows(self, weights: F64, stage: int) -> I64:
        """The next (n,) values of a stage, each with its own row of (n, k) `weights`: f - 1 (SPEC §10.5)."""
        return self._rans.decode_rows(weights).astype(np.int64)

    def finish(self) -> None:
        """Check the seal (SPEC §8.2)."""
        self._rans.finish()
