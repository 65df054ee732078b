"""Blocks of adaptive numbers (SPEC §8.5), coded by a rANS encoder in Python integers (§8.2)."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Sequence
from functools import reduce
from operator import or_

from conformance.writer.fields import folded

Number = tuple[tuple[str | int, ...], int]
"""What names a number model - a field, and the values of what is in its brackets - and a number."""
_MAX_SHIFT = 31
_Interval = tuple[int, int]
"""F and f of a symbol."""
_TOTAL, _WORD = 1 << 24, (1 << 32) - 1


def signed(field: tuple[str | int, ...], values: Iterable[int]) -> list[Number]:
    """Signed numbers of one field."""
    return [(field, folded(value)) for value in values]


def shifted(name: str, values: Sequence[int]) -> list[Number]:
    """Signed numbers of one field that may share zero bits at their end, shifted as R-8.5-3 recommends."""
    joined = reduce(or_, map(abs, values), 0)
    shift = min((joined & -joined).bit_length() - 1, _MAX_SHIFT) if joined else 0
    return [(("shift of", name), shift), *signed((name,), [value >> shift for value in values])]


def numbers_block(numbers: Iterable[Number]) -> bytes:
    """The block of numbers in their order. One of 2^32 - 1 or more gets the prefix that a reader refuses."""
    models: dict[tuple[str | int, ...], dict[tuple[str, int], _Bit]] = {}
    return rans_stream([part for field, n in numbers for part in _intervals(models.setdefault(field, {}), n + 1)])


class _Bit:
    """A bit model."""

    def __init__(self) -> None:
        self.zero, self.seen = 1 << 15, 0

    def put(self, bit: int) -> _Interval:
        """The interval of a bit, which the model learns."""
        split, self.seen = 256 * self.zero, min(self.seen + 1, 31)
        self.zero += -(self.zero // (self.seen + 1)) if bit else (65536 - self.zero) // (self.seen + 1)
        return (split, _TOTAL - split) if bit else (0, split)


def _intervals(model: dict[tuple[str, int], _Bit], value: int) -> Iterator[_Interval]:
    """The symbols of a number, which is `value` - 1."""
    length = value.bit_length() - 1
    for place in range(length + 1):
        yield model.setdefault(("prefix", place), _Bit()).put(int(place < length))
    for place in range(length - 1, -1, -1):
        bit = value >> place & 1
        if place == length - 1:
            yield model.setdefault(("second", length), _Bit()).put(bit)
        else:
            yield bit * _TOTAL // 2, _TOTAL // 2


def rans_stream(symbols: Sequence[_Interval]) -> bytes:
    """The stream of symbols."""
    state, words = 0, []
    for low, size in reversed(symbols):
        if state >> 40 >= size:
            words.append(state & _WORD)
            state >>= 32
        state = (state // size << 24) + low + state % size
    while state:
        words.append(state & _WORD)
        state >>= 32
    return struct.pack(f"<{len(words)}I", *words)
