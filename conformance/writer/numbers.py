"""Blocks of adaptive numbers (SPEC §8.5), those that a reader refuses among them."""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from typing import Any

from scarfmt.entropy.numbers import LARGEST, MAX_LENGTH, NumberWriter

Number = tuple[tuple[Any, ...], int]
"""What names a number model - a field, and what chooses among its models - and a number."""


class _Writer(NumberWriter):
    """Writes a number above `LARGEST` as 2^32 - 1, whose prefix is longer than any may be (R-8.5-1)."""

    def number(self, name: Hashable, value: int) -> None:
        if value <= LARGEST:
            super().number(name, value)
            return
        for place in range(MAX_LENGTH + 1):
            self._bit(self._models[name], place, 1)
        # The end of the prefix, and 32 bits of 0.
        for _ in range(MAX_LENGTH + 2):
            self._append(1 << 23, 0)


def numbers_block(numbers: Iterable[Number]) -> bytes:
    """The block of numbers in their order."""
    writer = _Writer()
    for field, number in numbers:
        writer.number(field, number)
    return writer.finish()
