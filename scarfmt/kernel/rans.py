"""The compiled rANS decoder (SPEC §8.2), and static tables as it reads them."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from ctypes import byref
from functools import cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from scarfmt.entropy.rans import PRECISION, FrequencyTable, check_rows, seal_error, words_of
from scarfmt.errors import InvalidInput
from scarfmt.kernel.interface import Members, Rans, Tables, check_symbols
from scarfmt.neural.tables import exp2_table

I64 = NDArray[np.int64]
I32 = NDArray[np.int32]
U16 = NDArray[np.uint16]
U32 = NDArray[np.uint32]
Ints = NDArray[np.integer[Any]]
F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

CONTEXTS = 256
"""Contexts of a component: kind = component's place * CONTEXTS + context."""
ALL_READ = -1
# Columns of logits that are worked on together.
_LANES = 16
# A logit so far below all others has no weight.
_NEVER = -float(1 << 25)


class Table(Protocol):
    """A static table over a sparse alphabet."""

    @property
    def alphabet(self) -> I64: ...

    @property
    def weights(self) -> I64: ...


class PackedTables:
    """The tables of some kinds of symbols, side by side.

    Args:
        tables: by (component's place, context).
        components: how many there are.
    """

    def __init__(self, tables: Mapping[tuple[int, int], Table], components: int) -> None:
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
        self._used = np.zeros(len(self._number), np.uint8)
        arrays = (self._number, self._starts, self._sums, self._values, self._used)
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


@cache
def exp2_weights() -> NDArray[np.uint32]:
    """The table of SPEC §10.1 as the library reads it."""
    return exp2_table().astype(np.uint32)


class PackedMembers:
    """The codewords of each cluster of a two-level head (SPEC §10.5).

    Attributes:
        sizes: (clusters,) int64 members of each.

    Args:
        weights: per cluster (width, members) float32.
        offsets: per cluster (members,) float32.
    """

    def __init__(self, weights: Sequence[F32], offsets: Sequence[F32]) -> None:
        self.sizes = np.array([len(part) for part in offsets])
        filled = -(-self.sizes // _LANES) * _LANES
        self._starts, self._places = (np.concatenate(([0], np.cumsum(sizes))) for sizes in (self.sizes, filled))
        more = filled - self.sizes
        wide = [np.pad(part, ((0, 0), (0, fill))) for part, fill in zip(weights, more, strict=True)]
        self._weights = np.concatenate([np.ascontiguousarray(part, np.float32).ravel() for part in wide])
        rows = [np.pad(part, (0, fill), constant_values=_NEVER) for part, fill in zip(offsets, more, strict=True)]
        self._offsets = np.concatenate(rows).astype(np.float32)
        arrays = self._starts, self._places, self._weights, self._offsets
        addresses = (array.ctypes.data for array in arrays)
        self.struct = Members(len(self.sizes), len(weights[0]), int(filled.max()), *addresses)


class KernelRansDecoder:
    """As :class:`scarfmt.entropy.rans.RansDecoder`, and faster where many tables take turns.

    Args:
        library: from :func:`scarfmt.kernel.functions`.
        data: the stream.

    Raises:
        Malformed: ``rans-length``, ``rans-last-word``.
    """

    def __init__(self, library: ctypes.CDLL, data: bytes) -> None:
        self.functions = library
        self._words = np.ascontiguousarray(words_of(data))
        self._rans = Rans(0, len(self._words), self._words.ctypes.data)
        self.pointer = byref(self._rans)
        library.scar_rans_open(self.pointer)

    def decode(self, table: FrequencyTable, count: int) -> I32:
        """The next `count` symbols, (count,) int32."""
        out = np.zeros(count, np.int32)
        if len(table) > 1 and count:
            sums = table.cumulative.astype(np.uint32)
            self.functions.scar_rans_table(self.pointer, sums.ctypes.data, len(table), count, out.ctypes.data)
        return out

    def uniform(self, size: int, count: int) -> I32:
        """The next `count` symbols of a uniform table of `size`, 1..4096."""
        out = np.zeros(count, np.int32)
        if size > 1:
            self.functions.scar_rans_uniform(self.pointer, size, count, out.ctypes.data)
        return out

    def grouped(self, tables: PackedTables, kinds: U16) -> I32 | int:
        """The next values, (n,) int32, grouped by ascending kind; a kind that has no table where there is one."""
        check_symbols(len(kinds))
        short = np.ascontiguousarray(kinds, np.uint16)
        out, order = np.empty((2, len(kinds)), np.int32)
        counts = np.empty(tables.kinds + 1, np.int64)
        addresses = (array.ctypes.data for array in (counts, order, out))
        read = self.functions.scar_rans_grouped(self.pointer, tables.pointer, short.ctypes.data, len(short), *addresses)
        return out if read == ALL_READ else int(read)

    def decode_rows(self, weights: F64) -> I32:
        """The next len(weights) symbols, (n,) int32, each with the frequencies weights[i] + 1."""
        out = np.zeros(len(weights), np.int32)
        if weights.shape[1] > 1 and len(weights):
            rows = np.ascontiguousarray(weights, np.float64)
            self.functions.scar_rans_rows(self.pointer, rows.ctypes.data, *rows.shape, out.ctypes.data)
        return out

    def decode_logits(self, logits: F32) -> I32:
        """The next n symbols, (n,) int32, of (k, n) float32 integer `logits` (SPEC §10.5)."""
        size, count = logits.shape
        out = np.zeros(count, np.int32)
        if size > 1 and count:
            rows = np.ascontiguousarray(logits, np.float32)
            scratch = np.empty((size + 1) * 2 * _LANES, np.uint32)
            addresses = (array.ctypes.data for array in (exp2_weights(), scratch, out))
            self.functions.scar_rans_logits(self.pointer, rows.ctypes.data, size, count, *addresses)
        return out

    def decode_members(self, members: PackedMembers, clusters: I64, o: F32) -> I32:
        """The member, (n,) int32, that each of n anchors chose in its cluster.

        Args:
            clusters: (n,) int64, of the head.
            o: (n, width) float32 outputs of the second projection.
        """
        out = np.empty(len(clusters), np.int32)
        struct, rows = members.struct, np.ascontiguousarray(o, np.float32)
        scratch: list[NDArray[Any]] = [np.empty(struct.clusters + 1, np.int64), np.empty(len(out), np.int64)]
        scratch += [np.empty(struct.largest, np.float32), np.empty(struct.largest, np.uint32)]
        arrays = [array.ctypes.data for array in (exp2_weights(), *scratch, out)]
        chosen = np.ascontiguousarray(clusters, np.int64)
        pointers = self.pointer, byref(struct), chosen.ctypes.data, rows.ctypes.data
        self.functions.scar_rans_members(*pointers, len(out), *arrays)
        return out

    def finish(self) -> None:
        """Check the end state (SPEC §8.2).

        Raises:
            Malformed: ``rans-seal`` when words or state are left.
        """
        if self._rans.state or self._rans.left:
            raise seal_error()


class KernelRansEncoder:
    """As :class:`scarfmt.entropy.rans.RansEncoder`: the same bytes, and faster where many tables take turns.

    It keeps of each symbol where it lies in its table.

    Args:
        library: from :func:`scarfmt.kernel.functions`.
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
        scratch = np.empty((size + 1) * 2 * _LANES, np.uint32)
        first, past = self._room(count)
        arrays = rows.ctypes.data, chosen.ctypes.data, size, count, exp2_weights().ctypes.data, scratch.ctypes.data
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
    """The same in one piece; refused rather than wrapped."""
    ends = np.iinfo(dtype)
    if numbers.dtype != dtype and not ends.min <= int(numbers.min()) <= int(numbers.max()) <= ends.max:
        raise InvalidInput("input-symbol", "a value that no table holds", field="symbols")
    return np.ascontiguousarray(numbers, dtype)


def _check_symbols(symbols: Ints, size: int) -> None:
    if len(symbols) and (int(symbols.min()) < 0 or int(symbols.max()) >= size):
        raise InvalidInput("input-symbol", f"symbol outside the alphabet of {size}", field="symbols")
