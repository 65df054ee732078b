"""The TABLES block: static tables as a layer sends them (SPEC §8.3), and which table is worth its bytes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from scarfmt.container.bytefields import ByteReader, signed_varint, unsigned_varint, varints
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.rans import MAX_ALPHABET
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.errors import Malformed

I64 = NDArray[np.int64]

MAX_TABLES = 1 << 16
# Weight precisions tried for a table; the cheapest of table bytes + coding loss wins.
_WEIGHT_BITS = (3, 5, 7, 9, 11, 13)


def fit_table(alphabet: I64, counts: I64) -> SymbolTable:
    """The table whose own bytes plus coding loss on `counts` are least."""
    best: SymbolTable | None = None
    least = float("inf")
    for bits in _WEIGHT_BITS:
        scaled = np.rint(counts * (((1 << bits) - 1) / counts.max())).astype(np.int64)
        candidate = SymbolTable(alphabet, np.maximum(scaled, 1))
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
    return SymbolTable(alphabet, weights)


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
