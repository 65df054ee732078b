"""Adaptive numbers (SPEC §8.5), of which all blocks of models but HASH_GRID are made."""

from __future__ import annotations

import struct
from itertools import accumulate
from operator import xor

from conformance.decoders.python.fields import TOTAL, Rans, require

Field = tuple[str | int, ...]
"""Names a number model: the field, and the values of what is in its brackets."""
_SECOND = 32


class Budget:
    """The numbers that the blocks of a file may still have together (SPEC §13.2)."""

    def __init__(self, left: int = 1 << 62) -> None:
        self.left = left


class Numbers:
    """The numbers of a block. `taken` has all that were read, each with its field."""

    def __init__(self, block: bytes, budget: Budget | None = None) -> None:
        self.rans = Rans(block, {})
        self._budget = budget or Budget()
        self.taken: list[tuple[Field, int]] = []
        self._models: dict[Field, list[list[int]]] = {}

    def number(self, *field: str | int) -> int:
        return self.numbers(1, *field)[0]

    def numbers(self, n: int, *field: str | int) -> list[int]:
        self.spend(n)
        return [self.read(field) for _ in range(n)]

    def spend(self, n: int) -> None:
        """Take n numbers, which are to be read, from the budget."""
        self._budget.left -= n
        require(self._budget.left >= 0, "limit-expansion")

    def read(self, field: Field) -> int:
        """A number that is taken from the budget already."""
        if field not in self._models:
            self._models[field] = [[1 << 15, 0] for _ in range(2 * _SECOND)]
        model = self._models[field]
        length, value = 0, 1
        while self._bit(model[length]):
            length += 1
            require(length <= 31, "bad-number")
        if length:
            value = 2 + self._bit(model[_SECOND + length])
        for _ in range(length - 1):
            value = 2 * value + self._halves(TOTAL // 2)
        self.taken.append((field, value - 1))
        return value - 1

    def _bit(self, model: list[int]) -> int:
        p, n = model
        bit = self._halves(256 * p)
        model[:] = p - p // (n + 2) if bit else p + (65536 - p) // (n + 2), min(n + 1, 30)
        return bit

    def _halves(self, split: int) -> int:
        """A symbol of the table of two symbols with the frequencies `split` and the rest."""
        bit = int(self.rans.slot() >= split)
        self.rans.leave(*((split, TOTAL) if bit else (0, split)))
        return bit

    def count(self, most: int, *field: str | int) -> int:
        value = self.number(*field)
        require(value <= most, "count-limit")
        return value

    def signed(self, n: int, *field: str | int) -> list[int]:
        return [u // 2 if u % 2 == 0 else -(u // 2) - 1 for u in self.numbers(n, *field)]

    def take_shifted(self, n: int, field: str) -> list[int]:
        shift = self.count(31, "shift of", field)
        values = [v << shift for v in self.signed(n, field)]
        require(all(abs(v) < 1 << 31 for v in values), "bad-number")
        return values

    def f32(self, n: int, *field: str | int) -> list[float]:
        return list(struct.unpack(f"<{n}f", struct.pack(f"<{n}I", *self.numbers(n, *field))))

    def xor_f32(self, n: int, *field: str | int) -> list[float]:
        bits = accumulate(self.numbers(n, *field), xor)
        return list(struct.unpack(f"<{n}f", struct.pack(f"<{n}I", *bits)))

    def seal(self) -> None:
        self.rans.seal()
