"""The compiled rANS encoder (SPEC §8.2)."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F32, F64, U16, U32, Ints
from scarfmt.entropy.rans import PRECISION, FrequencyTable, check_rows
from scarfmt.errors import InvalidInput
from scarfmt.kernel.members import EXP2_WEIGHTS, LANES
from scarfmt.kernel.packed_tables import PackedTables
from scarfmt.kernel.stream_decoder import ALL_READ


class KernelRansEncoder:
    """A rANS encoder equal to :class:`scarfmt.entropy.rans.RansEncoder`, and faster where many tables take turns.

    It keeps of each symbol where it lies in its table.

    Args:
        library: the compiled library.
    """

    def __init__(self, library: ctypes.CDLL) -> None:
        self._library = library
        # (2, n) uint32 of each group: first slots, and those past the last.
        self._spans: list[U32] = []

    def encode(self, symbols: Ints, table: FrequencyTable) -> None:
        """Append `symbols`, (count,) integers in 0..n-1, coded with `table`.

        Raises:
            InvalidInput: ``input-symbol``.
        """
        _check_symbols(symbols, len(table))
        if len(symbols) and len(table) > 1:
            sums = table.cumulative
            self._spans.append(np.stack([sums[symbols], sums[1:][symbols]]).astype(np.uint32))

    def encode_rows(self, symbols: Ints, weights: F64) -> None:
        """Append (n,) `symbols`, each with the frequencies weights[i] + 1, (n, k).

        Raises:
            InvalidInput: ``input-symbol``, ``input-table``.
        """
        rows = np.ascontiguousarray(weights, np.float64)
        check_rows(rows, len(symbols))
        _check_symbols(symbols, rows.shape[1])
        if len(symbols) and rows.shape[1] > 1:
            chosen = np.ascontiguousarray(symbols, np.int32)
            first, past = self._room(len(chosen))
            self._library.scar_spans_rows(rows.ctypes.data, chosen.ctypes.data, *rows.shape, first, past)

    def encode_logits(self, symbols: Ints, logits: F32) -> F64:
        """Append (n,) `symbols` of (k, n) float32 integer `logits` (SPEC §10.5); returns what each costs, in bits.

        Raises:
            InvalidInput: ``input-symbol``, ``input-table``.
        """
        size, count = logits.shape
        if count != len(symbols):
            raise InvalidInput("input-table", f"logits of {count} symbols, not {len(symbols)}", field="table")
        _check_symbols(symbols, size)
        if size == 1 or not count:
            return np.zeros(count)
        rows, chosen = np.ascontiguousarray(logits, np.float32), np.ascontiguousarray(symbols, np.int32)
        scratch = np.empty((size + 1) * 2 * LANES, np.uint32)
        first, past = self._room(count)
        arrays = rows.ctypes.data, chosen.ctypes.data, size, count, EXP2_WEIGHTS.ctypes.data, scratch.ctypes.data
        self._library.scar_spans_logits(*arrays, first, past)
        spans = self._spans[-1]
        return np.asarray(PRECISION - np.log2((spans[1] - spans[0]).astype(np.float64)))

    def encode_grouped(self, tables: PackedTables, kinds: Ints, values: Ints) -> None:
        """Append (n,) `values`, grouped by ascending kind, order kept within each group.

        Raises:
            InvalidInput: ``input-symbol`` for a value or a kind that no table holds.
        """
        if not len(values):
            return
        short, chosen = _narrowed(kinds, np.uint16), _narrowed(values, np.int32)
        if len(short) != len(chosen):
            raise InvalidInput("input-symbol", f"{len(short)} kinds of {len(chosen)} values", field="symbols")
        counts, order = np.empty(tables.kinds + 1, np.int64), np.empty(len(chosen), np.int32)
        first, past = self._room(len(chosen))
        arrays = short.ctypes.data, chosen.ctypes.data, len(chosen), counts.ctypes.data, order.ctypes.data
        if self._library.scar_spans_grouped(tables.pointer, *arrays, first, past) != ALL_READ:
            self._spans.pop()
            raise InvalidInput("input-symbol", "a value that no table holds", field="symbols")

    def encode_groups(
        self, coders: Sequence[int | PackedTables], lengths: Sequence[int], kinds: U16, values: Ints
    ) -> None:
        """Append groups of values, one after the other.

        Args:
            coders: of each group, the size of its uniform alphabet, or its tables.
            lengths: of each group.
            kinds: of the values that have tables.
            values: of all groups.

        Raises:
            InvalidInput: ``input-symbol`` for a value or a kind that no table holds.
        """
        if not len(values):
            return
        sizes = [coder if isinstance(coder, int) else 0 for coder in coders]
        tables = [None if isinstance(coder, int) else ctypes.addressof(coder.pointer.contents) for coder in coders]
        counted = sum(length for length, size in zip(lengths, sizes, strict=True) if not size)
        chosen = _narrowed(values, np.int32)
        if sum(lengths) != len(chosen) or counted != len(kinds):
            raise InvalidInput("input-symbol", f"{len(kinds)} kinds of {len(chosen)} values", field="symbols")
        told, short = np.array([sizes, lengths], np.int64), np.ascontiguousarray(kinds, np.uint16)
        most = max((coder.kinds for coder in coders if not isinstance(coder, int)), default=0)
        scratch = np.empty(most + 1, np.int64), np.empty(max(lengths), np.int32)
        first, past = self._room(len(chosen))
        arrays = told[0].ctypes.data, (ctypes.c_void_p * len(tables))(*tables), told[1].ctypes.data, len(tables)
        lent = short.ctypes.data, chosen.ctypes.data, *(array.ctypes.data for array in scratch)
        if self._library.scar_spans_groups(*arrays, *lent, first, past) != ALL_READ:
            self._spans.pop()
            raise InvalidInput("input-symbol", "a value that no table holds", field="symbols")

    def _room(self, count: int) -> tuple[int, int]:
        spans = np.empty((2, count), np.uint32)
        self._spans.append(spans)
        return spans[0].ctypes.data, spans[1].ctypes.data

    def finish(self) -> bytes:
        """The sealed stream: 32-bit little-endian words, empty when nothing was coded."""
        if not self._spans:
            return b""
        first, past = (np.concatenate([spans[row] for spans in self._spans]) for row in (0, 1))
        words = np.empty(len(first) + 2, np.uint32)
        count = self._library.scar_rans_encode(first.ctypes.data, past.ctypes.data, len(first), words.ctypes.data)
        return words[:count].astype("<u4").tobytes()


def _narrowed(numbers: Ints, dtype: type[np.integer[Any]]) -> NDArray[Any]:
    """Values as one piece of 32-bit numbers; what does not fit is refused rather than wrapped."""
    ends = np.iinfo(dtype)
    if numbers.dtype != dtype and not ends.min <= int(numbers.min()) <= int(numbers.max()) <= ends.max:
        raise InvalidInput("input-symbol", "a value that no table holds", field="symbols")
    return np.ascontiguousarray(numbers, dtype)


def _check_symbols(symbols: Ints, size: int) -> None:
    if len(symbols) and (int(symbols.min()) < 0 or int(symbols.max()) >= size):
        raise InvalidInput("input-symbol", f"symbol outside the alphabet of {size}", field="symbols")
