"""Groups of symbols, the tables that code them, and the TABLES block (SPEC §8.3).

A group is a run of values that share one static table, named by a :class:`TableKey`. The encoder runs
each codec twice over the same interface: once with a :class:`SymbolCounter` to learn the tables, once with
a :class:`SymbolWriter` to code. Alphabets are sparse: a table lists the values it can code, so a value
nobody used costs nothing and an outlier costs two bytes, not a wide alphabet.
"""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from scarfmt import kernel
from scarfmt.container.bytefields import ByteReader, signed_varint, unsigned_varint, varints
from scarfmt.entropy.rans import (
    MAX_ALPHABET,
    PRECISION,
    FrequencyTable,
    RansDecoder,
    RansEncoder,
    SymbolSource,
    uniform_table,
)
from scarfmt.errors import InvalidInput, Malformed
from scarfmt.kernel.rans import CONTEXTS, KernelRansDecoder, KernelRansEncoder, PackedMembers, PackedSteps, PackedTables

Values = NDArray[np.integer[Any]]
I64 = NDArray[np.int64]
I32 = NDArray[np.int32]
F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

MAX_TABLES = 1 << 16
# Weight precisions tried for a table; the cheapest of table bytes + coding loss wins.
_WEIGHT_BITS = (3, 5, 7, 9, 11, 13)


class TableKey(NamedTuple):
    """Names a static table: the stream it codes, component, step of refinement and context (SPEC §8.3)."""

    stream: int
    component: int
    step: int
    context: int

    @property
    def number(self) -> int:
        """The key as the unsigned integer that orders and names it in a TABLES block."""
        return (self.stream << 24) | (self.component << 16) | (self.step << 8) | self.context

    @classmethod
    def from_number(cls, number: int) -> TableKey:
        """The inverse of :attr:`number`."""
        return cls(number >> 24, (number >> 16) & 255, (number >> 8) & 255, number & 255)


class StepKey(NamedTuple):
    """Names the tables of one step of some components of a stream: one a component and context.

    A kind is 256 * (a component's place in `components`) + context.
    """

    stream: int
    components: tuple[int, ...]
    step: int

    def table(self, kind: int) -> TableKey:
        """The key of a kind's table."""
        return TableKey(self.stream, self.components[kind // CONTEXTS], self.step, kind % CONTEXTS)


@dataclass(frozen=True)
class SymbolTable:
    """Frequencies over a sparse alphabet of integers.

    Attributes:
        alphabet: (n,) int64, strictly ascending values.
        weights: (n,) int64, each >= 1, their sum below 2^39.
    """

    alphabet: I64
    weights: I64

    @classmethod
    def from_weights(cls, alphabet: I64, weights: I64) -> SymbolTable:
        return cls(alphabet, weights)

    @cached_property
    def table(self) -> FrequencyTable:
        """The frequency table of the weights (SPEC §8.1); made when something is coded with it."""
        return FrequencyTable.from_weights(self.weights)

    def cost_of_counts(self, alphabet: I64, counts: I64) -> float:
        """Bits to code `counts` symbols of each value of `alphabet`; infinite if one is not codable."""
        slots = np.minimum(np.searchsorted(self.alphabet, alphabet), len(self.alphabet) - 1)
        if not np.array_equal(self.alphabet[slots], alphabet):
            return float("inf")
        return float((self.table.bits[slots] * counts).sum())


class StaticTables(dict[TableKey, SymbolTable]):
    """The static tables in force in a layer, by key."""

    def __init__(self, tables: Mapping[TableKey, SymbolTable]) -> None:
        super().__init__(tables)
        self._packed: dict[StepKey, PackedTables] = {}
        self._packed_steps: dict[tuple[int, int, range], PackedSteps] = {}

    def packed(self, key: StepKey) -> PackedTables:
        """The tables of a step side by side, as the compiled decoder reads them. Threads may share them."""
        if key not in self._packed:
            found = {}
            for place, component in enumerate(key.components):
                for context in self._contexts.get((key.stream, component, key.step), ()):
                    found[place, context] = self[TableKey(key.stream, component, key.step, context)]
            self._packed[key] = PackedTables(found, len(key.components))
        return self._packed[key]

    def packed_steps(self, stream: int, components: int, steps: range) -> PackedSteps:
        """The same of some steps of all components of a channel."""
        key = (stream, components, steps)
        if key not in self._packed_steps:
            every = tuple(range(components))
            self._packed_steps[key] = PackedSteps([self.packed(StepKey(stream, every, step)) for step in steps])
        return self._packed_steps[key]

    def used_packed(self) -> set[TableKey]:
        """The tables that the compiled decoder has read a symbol with."""
        return {key.table(kind) for key, tables in self._packed.items() for kind in tables.used.tolist()}

    @cached_property
    def _contexts(self) -> dict[tuple[int, int, int], list[int]]:
        out: dict[tuple[int, int, int], list[int]] = {}
        for stream, component, step, context in self:
            out.setdefault((stream, component, step), []).append(context)
        return out


class Emitter(Protocol):
    """Takes groups of symbols in decoding order."""

    def emit(self, key: TableKey, values: Values) -> None: ...

    def emit_uniform(self, size: int, values: Values) -> None: ...

    def emit_rows(self, weights: F64, values: Values) -> None: ...


class GroupEmitter(ABC):
    """An emitter that can take many groups at once: those of one step of some components, by ascending kind."""

    @abstractmethod
    def emit_grouped(self, key: StepKey, kinds: Values, values: Values) -> None:
        """(n,) `values` with their (n,) kinds (see :class:`StepKey`), order kept within each group (SPEC §8.4)."""

    @abstractmethod
    def emit_logits(self, logits: F32, values: Values) -> None:
        """(n,) `values` of (k, n) integer `logits`; only while the compiled library is in use."""


class SymbolCounter(GroupEmitter):
    """An emitter that only counts, per table key."""

    def __init__(self) -> None:
        self._values: dict[TableKey, list[Values]] = {}
        # Per step: (m,) joint numbers of kind and value, and how often each came.
        self._joint: dict[StepKey, list[tuple[I64, I64]]] = {}
        self.uniform_bits = 0.0
        self.modelled_bits = 0.0

    def emit(self, key: TableKey, values: Values) -> None:
        if len(values):
            self._values.setdefault(key, []).append(values)

    def emit_grouped(self, key: StepKey, kinds: Values, values: Values) -> None:
        if len(values):
            self._joint.setdefault(key, []).append(_joint_counts(kinds, values))

    def emit_logits(self, logits: F32, values: Values) -> None:
        library = kernel.functions()
        assert library is not None
        self.modelled_bits += float(KernelRansEncoder(library).encode_logits(values, logits).sum())

    def emit_uniform(self, size: int, values: Values) -> None:
        self.uniform_bits += len(values) * float(np.log2(size))

    def emit_rows(self, weights: F64, values: Values) -> None:
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


def _joint_counts(kinds: Values, values: Values) -> tuple[I64, I64]:
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


def rans_encoder() -> RansEncoder | KernelRansEncoder:
    """The fastest there is."""
    library = kernel.functions()
    return RansEncoder() if library is None else KernelRansEncoder(library)


class SymbolWriter(GroupEmitter):
    """An emitter that codes one sub-stream."""

    def __init__(self, tables: Mapping[TableKey, SymbolTable]) -> None:
        self._tables = tables if isinstance(tables, StaticTables) else StaticTables(tables)
        self._rans = rans_encoder()

    def emit_grouped(self, key: StepKey, kinds: Values, values: Values) -> None:
        if isinstance(self._rans, KernelRansEncoder):
            self._rans.encode_grouped(self._tables.packed(key), kinds, values)
            return
        order, runs = by_context(kinds)
        arranged = values[order]
        for kind, start, past in runs:
            self.emit(key.table(kind), arranged[start:past])

    def emit_logits(self, logits: F32, values: Values) -> None:
        assert isinstance(self._rans, KernelRansEncoder)
        self._rans.encode_logits(values, logits)

    def emit(self, key: TableKey, values: Values) -> None:
        if len(values):
            entry = self._tables[key]
            self._rans.encode(np.searchsorted(entry.alphabet, values), entry.table)

    def emit_uniform(self, size: int, values: Values) -> None:
        self._rans.encode(values, cached_uniform(size))

    def emit_rows(self, weights: F64, values: Values) -> None:
        self._rans.encode_rows(values, weights)

    def finish(self) -> bytes:
        """The sealed rANS stream."""
        return self._rans.finish()


class SymbolRecorder(GroupEmitter):
    """An emitter that keeps what it is given, to be coded once the tables are known.

    Args:
        counter: told of every group that needs a table.
    """

    def __init__(self, counter: SymbolCounter) -> None:
        self._counter = counter
        self._groups: list[tuple[TableKey | int, Values] | tuple[StepKey, Values, Values]] = []
        self._modelled = rans_encoder()
        self._coded = b""

    def emit(self, key: TableKey, values: Values) -> None:
        self._counter.emit(key, values)
        self._groups.append((key, values))

    def emit_uniform(self, size: int, values: Values) -> None:
        self._groups.append((size, values))

    def emit_grouped(self, key: StepKey, kinds: Values, values: Values) -> None:
        self._counter.emit_grouped(key, kinds, values)
        self._groups.append((key, kinds.astype(np.uint16), values.astype(np.int32)))

    def emit_rows(self, weights: F64, values: Values) -> None:
        self._modelled.encode_rows(values, weights)

    def emit_logits(self, logits: F32, values: Values) -> None:
        assert isinstance(self._modelled, KernelRansEncoder)
        self._modelled.encode_logits(values, logits)

    def settle(self) -> None:
        """Code symbols that came with their own frequencies: those take much memory, and wait for no table.

        Raises:
            InvalidInput: ``input-symbol`` when the stream has others, too.
        """
        self._coded, self._modelled = self._modelled.finish(), rans_encoder()
        if self._coded and self._groups:
            raise InvalidInput("input-symbol", "a sub-stream mixes static tables and rows", field="symbols")

    def code(self, tables: Mapping[TableKey, SymbolTable]) -> bytes:
        """The sealed rANS stream."""
        writer = SymbolWriter(tables)
        for key, *arrays in self._groups:
            if isinstance(key, StepKey):
                writer.emit_grouped(key, *arrays)
            elif isinstance(key, TableKey):
                writer.emit(key, *arrays)
            else:
                writer.emit_uniform(key, *arrays)
        return self._coded or writer.finish()


class SymbolReader:
    """Reads one sub-stream, group by group.

    Args:
        data: the sub-stream.
        tables: static tables in force.
        source: decodes in place of the fastest decoder there is.

    Attributes:
        static, uniform, modelled: symbols read so far, by what coded them (:class:`scarfmt.coding.counters.Coding`).
    """

    def __init__(self, data: bytes, tables: Mapping[TableKey, SymbolTable], source: SymbolSource | None = None) -> None:
        self._tables = tables
        library = kernel.functions()
        if source is None:
            source = RansDecoder(data) if library is None else KernelRansDecoder(library, data)
        self._rans = source
        self.static = self.uniform = self.modelled = 0

    @property
    def compiled(self) -> KernelRansDecoder | None:
        """The decoder, if it is the compiled one and nobody wants to see single groups."""
        return self._rans if isinstance(self._rans, KernelRansDecoder) else None

    def read(self, key: TableKey, count: int) -> I64:
        """The next `count` values, (count,) int64.

        Raises:
            Malformed: ``missing-table`` when no TABLES block so far holds `key`.
        """
        if not count:
            return np.zeros(0, np.int64)
        entry = self._tables.get(key)
        if entry is None:
            raise missing_table(key)
        self.static += count
        if len(entry.alphabet) == 1:
            return np.repeat(entry.alphabet, count)
        return entry.alphabet.take(self._rans.decode(entry.table, count))

    @property
    def tables(self) -> StaticTables:
        """Those in force, for :attr:`compiled`."""
        if not isinstance(self._tables, StaticTables):
            self._tables = StaticTables(self._tables)
        return self._tables

    def read_grouped(self, key: StepKey, kinds: Values) -> I32:
        """The next values, (n,) int32, grouped by ascending kind, order kept within each group (SPEC §8.4).

        Args:
            key: of the tables.
            kinds: (n,) what :class:`StepKey` says, below 2^14.

        Raises:
            Malformed: ``missing-table``.
        """
        compiled = self.compiled
        if compiled is not None:
            found = compiled.grouped(self.tables.packed(key), kinds.astype(np.uint16, copy=False))
            if isinstance(found, int):
                raise missing_table(key.table(found))
            self.static += len(kinds)
            return found
        out = np.empty(len(kinds), np.int32)
        arranged = np.empty(len(kinds), np.int32)
        order, runs = by_context(kinds)
        for kind, start, past in runs:
            arranged[start:past] = self.read(key.table(kind), past - start)
        out[order] = arranged
        return out

    def read_uniform(self, size: int, count: int) -> I64:
        """The next `count` values of a uniform alphabet 0..size-1."""
        self.uniform += count
        if isinstance(self._rans, KernelRansDecoder):
            return self._rans.uniform(size, count).astype(np.int64)
        return self._rans.decode(cached_uniform(size), count).astype(np.int64)

    def read_rows(self, weights: F64, stage: int) -> I64:
        """The next (n,) values of a stage, each with its own row of (n, k) `weights`: f - 1 (SPEC §10.5)."""
        self.modelled += len(weights)
        return self._rans.decode_rows(weights).astype(np.int64)

    def read_logits(self, logits: F32 | None, weights: Callable[[], F64], stage: int) -> I64:
        """The same, of (k, n) integer `logits` where they are at hand, else of the `weights` that come from them."""
        compiled = self.compiled
        if compiled is None or logits is None:
            return self.read_rows(weights(), stage)
        self.modelled += logits.shape[1]
        return compiled.decode_logits(logits).astype(np.int64)

    def read_members(self, members: PackedMembers, clusters: I64, o: F32) -> I32:
        """The members, (n,) int32, that follow (n,) `clusters` in a two-level head; of :attr:`compiled` only."""
        assert self.compiled is not None
        self.modelled += int(np.count_nonzero(members.sizes[clusters] > 1))
        return self.compiled.decode_members(members, clusters, o)

    def finish(self) -> None:
        """Check the seal (SPEC §8.2)."""
        self._rans.finish()


def missing_table(key: TableKey) -> Malformed:
    """The refusal of a symbol whose table was not sent."""
    return Malformed("missing-table", f"no static table for {key} (SPEC §8.3)", field="tables")


# Few sizes are in use; large tables take 130 KB each with their model, so not all of them are kept.
@lru_cache(maxsize=128)
def cached_uniform(size: int) -> FrequencyTable:
    """The uniform table of `size` symbols, made once."""
    return uniform_table(size)


def fit_table(alphabet: I64, counts: I64) -> SymbolTable:
    """The table whose own bytes plus coding loss on `counts` are least."""
    best: SymbolTable | None = None
    least = float("inf")
    for bits in _WEIGHT_BITS:
        scaled = np.rint(counts * (((1 << bits) - 1) / counts.max())).astype(np.int64)
        candidate = SymbolTable.from_weights(alphabet, np.maximum(scaled, 1))
        cost = float((candidate.table.bits * counts).sum()) + 8 * len(_pack_weights(candidate.weights))
        if cost < least:
            best, least = candidate, cost
    assert best is not None
    return best


def _pack_weights(weights: I64) -> bytes:
    return b"".join(unsigned_varint(int(weight)) for weight in weights)


def pack_table(key: TableKey, table: SymbolTable) -> bytes:
    """One table record of a TABLES block (SPEC §8.3)."""
    parts = [unsigned_varint(key.number), unsigned_varint(len(table.alphabet)), signed_varint(int(table.alphabet[0]))]
    parts += [unsigned_varint(int(gap) - 1) for gap in np.diff(table.alphabet)]
    parts.append(_pack_weights(table.weights))
    return b"".join(parts)


def pack_tables(tables: Mapping[TableKey, SymbolTable]) -> bytes:
    """The payload of a TABLES block before zstd (SPEC §8.3), records by ascending key."""
    records = [pack_table(key, tables[key]) for key in sorted(tables)]
    return unsigned_varint(len(records)) + b"".join(records)


def unpack_tables(payload: bytes) -> dict[TableKey, SymbolTable]:
    """The inverse of :func:`pack_tables`.

    Raises:
        Malformed: ``bad-table`` for a record that breaks SPEC §8.3.
    """
    found = _unpack_sound(payload)
    if found is not None:
        return found
    reader = ByteReader(payload, "tables")
    tables: dict[TableKey, SymbolTable] = {}
    previous = -1
    for _ in range(reader.count(MAX_TABLES)):
        number = reader.unsigned(32)
        if number <= previous:
            raise _bad_table("table keys must ascend strictly")
        previous = number
        tables[TableKey.from_number(number)] = _read_table(reader)
    reader.finish()
    return tables


# Fifty times as much memory is in use meanwhile; tables of real scenes take a fiftieth of this.
_AT_ONCE = 1 << 20


def _unpack_sound(payload: bytes) -> dict[TableKey, SymbolTable] | None:
    """:func:`unpack_tables` of a payload that breaks no rule, all numbers at once; None of any other."""
    numbers = varints(payload, bits=33) if len(payload) <= _AT_ONCE else None
    if numbers is None or not numbers[0] <= MAX_TABLES:
        return None
    records = _records(numbers)
    if records is None:
        return None
    keys, sizes, at = records
    # Per record: key, size, then as many numbers that make the alphabet, and as many weights.
    place = np.arange(int(sizes.sum())) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    start = np.repeat(at, sizes) + place
    steps, weights = numbers[start], numbers[start + np.repeat(sizes, sizes)]
    first = (steps >> 1) ^ -(steps & 1)
    running = np.cumsum(np.where(place == 0, first, steps + 1))
    begins = np.cumsum(sizes) - sizes
    base = running[begins] - first[begins]
    alphabet = running - np.repeat(base, sizes)
    sound = bool(((steps < 1 << 32) | (place == 0)).all()) and bool((np.diff(keys) > 0).all())
    sound &= bool((np.abs(alphabet) < 1 << 31).all()) and bool(((weights >= 1) & (weights < 1 << 24)).all())
    if not sound:
        return None
    spans = zip(keys.tolist(), begins.tolist(), (begins + sizes).tolist(), strict=True)
    return {TableKey.from_number(key): SymbolTable(alphabet[a:b], weights[a:b]) for key, a, b in spans}


def _records(numbers: I64) -> tuple[I64, I64, I64] | None:
    """Key, size and place of the first alphabet number of each record, (tables,) each; None if they do not fit."""
    keys, sizes, places, at = [], [], [], 1
    # One by one: where a record begins, only the one before tells.
    plain = numbers.tolist()
    for _ in range(plain[0]):
        if at + 2 > len(plain) or not 1 <= plain[at + 1] <= MAX_ALPHABET or plain[at] >= 1 << 32:
            return None
        keys.append(plain[at])
        sizes.append(plain[at + 1])
        places.append(at + 2)
        at += 2 + 2 * plain[at + 1]
    if at != len(plain):
        return None
    return np.array(keys, np.int64), np.array(sizes, np.int64), np.array(places, np.int64)


def _read_table(reader: ByteReader) -> SymbolTable:
    size = reader.count(MAX_ALPHABET)
    if size == 0:
        raise _bad_table("a table needs at least one symbol")
    start = reader.position
    try:
        return _read_rows(reader, size)
    except Malformed:
        reader.rewind(start)
        _refuse_first_fault(reader, size)
        raise


def _read_rows(reader: ByteReader, size: int) -> SymbolTable:
    """Alphabet and weights, many numbers at once: which of several faults is refused is left open."""
    first = reader.signed(33)
    alphabet = np.full(size, first, np.int64)
    alphabet[1:] += np.cumsum(reader.unsigned_array(32, size - 1) + 1)
    if abs(first) >= 1 << 31 or int(alphabet[-1]) >= 1 << 31:
        raise _bad_table("alphabet values must fit 32 bits")
    weights = reader.unsigned_array(24, size)
    if int(weights.min()) < 1:
        raise _bad_table("weights must be 1 or more")
    # Sums of weights so small need no further check.
    return SymbolTable.from_weights(alphabet, weights)


def _refuse_first_fault(reader: ByteReader, size: int) -> None:
    """The same numbers one by one: content is refused for what comes first in it (SPEC §12.2)."""
    value = reader.signed(33)
    for place in range(size):
        value += reader.unsigned(32) + 1 if place else 0
        if abs(value) >= 1 << 31:
            raise _bad_table("alphabet values must fit 32 bits")
    for _ in range(size):
        if not reader.unsigned(24):
            raise _bad_table("weights must be 1 or more")


def _bad_table(message: str) -> Malformed:
    return Malformed("bad-table", f"{message} (SPEC §8.3)", field="tables")


def by_context(contexts: Values) -> tuple[I64, list[tuple[int, int, int]]]:
    """Stable order by ascending context, (n,) below 2^14, and (context, start, past) of each run in it."""
    # As few bits as possible: numpy sorts 8 and 16 bits by counting.
    small = contexts.astype(np.uint8 if len(contexts) and contexts.max() < 256 else np.uint16)
    order = np.argsort(small, kind="stable")
    counts = np.bincount(small)
    present = np.flatnonzero(counts)
    ends = np.cumsum(counts[present]).tolist()
    return order, list(zip(present.tolist(), [0, *ends][:-1], ends, strict=True))


def emit_by_context(emitter: Emitter, key: TableKey, contexts: I64, values: Values) -> None:
    """Emit `values` grouped by ascending context (0..255), order kept within each group (SPEC §8.4).

    Args:
        key: the tables' key; its context is replaced.
        contexts, values: (n,) each.
    """
    emit_grouped(emitter, StepKey(key.stream, (key.component,), key.step), contexts, values)


def emit_grouped(emitter: Emitter, key: StepKey, kinds: Values, values: Values) -> None:
    """Emit (n,) `values` grouped by ascending kind, order kept within each group: what `read_grouped` reads."""
    if not len(values):
        return
    if isinstance(emitter, GroupEmitter):
        emitter.emit_grouped(key, kinds, values)
        return
    order, runs = by_context(kinds)
    arranged = values[order]
    for kind, start, past in runs:
        emitter.emit(key.table(kind), arranged[start:past])


def read_by_context(reader: SymbolReader, key: TableKey, contexts: I64) -> I32:
    """The inverse of :func:`emit_by_context`: (n,) int32."""
    return reader.read_grouped(StepKey(key.stream, (key.component,), key.step), contexts)
