"""Bytes and entropy coding of the second decoder: SPEC.md §5.7 and §8 in plain loops, standard library only."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any, NamedTuple

POSITIONS, CLASSES, MASKS, POSITION_RESIDUAL, SCALE, ROTATION, OPACITY, COLOUR = range(1, 9)
INDICES, LATENT, OFFSETS = 9, 10, 11
TOTAL = 1 << 24


class Refused(Exception):
    """A refusal id of SPEC §12."""


def require(holds: bool, refusal: str) -> None:
    if not holds:
        raise Refused(refusal)


# ---------------------------------------------------------------------------------------------- 5.7 fields


class Payload:
    """A cursor over bytes (SPEC §5.7)."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.at = 0

    def take(self, length: int) -> bytes:
        require(self.at + length <= len(self.data), "payload-short")
        self.at += length
        return self.data[self.at - length : self.at]

    def fields(self, layout: str) -> tuple[Any, ...]:
        return struct.unpack("<" + layout, self.take(struct.calcsize("<" + layout)))

    def u8(self) -> int:
        return self.take(1)[0]

    def varint(self, b: int) -> int:
        value = shift = 0
        while True:
            byte = self.u8()
            value |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                break
            require(shift <= b, "bad-varint")
        require(value < 1 << b and not (byte == 0 and shift > 7), "bad-varint")
        return value

    def finish(self) -> None:
        require(self.at == len(self.data), "payload-long")


# ---------------------------------------------------------------------------------------------- 8 entropy coding


class Table(NamedTuple):
    """Symbols' values and cumulative frequencies (SPEC §8.1, §8.3)."""

    values: Sequence[int]
    cumulative: list[int]


def cumulative(weights: list[int]) -> list[int]:
    n, total, c, out = len(weights), sum(weights), 0, []
    for i in range(n + 1):
        out.append(c * (TOTAL - n) // total + i)
        c += weights[i] if i < n else 0
    return out


def key(stream: int, component: int, step: int, context: int) -> int:
    return stream << 24 | component << 16 | step << 8 | context


class Rans:
    """One sub-stream (SPEC §8.2). `first` is the table of the first symbol read, or read since it was forgotten.

    `used` has the keys of all tables that symbols were read with.
    """

    first: Table | None

    def __init__(self, data: bytes, tables: dict[int, Table]) -> None:
        self.forget()
        self.used: set[int] = set()
        require(len(data) % 4 == 0, "rans-length")
        self.words = list(struct.unpack(f"<{len(data) // 4}I", data))
        require(not self.words or self.words[-1] != 0, "rans-last-word")
        self.tables = tables
        self.state = 0
        self.refill()
        self.refill()

    def forget(self) -> None:
        self.first = None

    def refill(self) -> None:
        if self.state < 1 << 32 and self.words:
            self.state = self.state << 32 | self.words.pop()

    def symbol(self, table: Table) -> int:
        self.first = self.first or table
        c = table.cumulative
        if len(c) == 2:
            return table.values[0]
        slot = self.slot()
        low, high = 0, len(c) - 1
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if c[middle] <= slot else (low, middle)
        self.leave(c[low], c[high])
        return table.values[low]

    def slot(self) -> int:
        return self.state & (TOTAL - 1)

    def leave(self, low: int, past: int) -> None:
        """The state after a symbol whose slots are `low` to `past` - 1."""
        self.state = (past - low) * (self.state >> 24) + self.slot() - low
        self.refill()

    def read(self, number: int, n: int) -> list[int]:
        if n == 0:
            return []
        require(number in self.tables, "missing-table")
        self.used.add(number)
        return [self.symbol(self.tables[number]) for _ in range(n)]

    def uniform(self, m: int, n: int) -> list[int]:
        table = Table(range(m), cumulative([1] * m)) if n else None
        return [self.symbol(table) for _ in range(n)] if table else []

    def read_by_context(self, number: int, contexts: list[int]) -> list[int]:
        out = [0] * len(contexts)
        for c in sorted(set(contexts)):
            chosen = [e for e, context in enumerate(contexts) if context == c]
            for e, value in zip(chosen, self.read(number | c, len(chosen)), strict=True):
                out[e] = value
        return out

    def seal(self) -> None:
        require(self.state == 0 and not self.words, "rans-seal")
