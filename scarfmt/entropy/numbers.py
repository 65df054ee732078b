"""Adaptive numbers: what the models of a file are made of, bit by bit through the rANS coder (SPEC §8.5).

A number is Exp-Golomb-coded: how many bits it has in unary, then the bits. The probability of each unary bit, and of
the bit after the leading one, follows the bits that were there before.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Hashable

import numpy as np

from scarfmt.container.bytefields import Trace
from scarfmt.entropy.rans import PRECISION, RansEncoder, words_of
from scarfmt.errors import LimitExceeded, Malformed

MAX_LENGTH = 31
"""Bits after the leading one."""
LARGEST = (1 << (MAX_LENGTH + 1)) - 2
"""The largest number."""

Spend = Callable[[int], bool]
"""Whether the blocks of a file may have so many numbers more (SPEC §13.2)."""

_EVEN, _ONE = 1 << 15, 1 << 16
_UNIT = PRECISION - 16
_MOST_SEEN = 30
_SLOT, _HALF, _WORD = (1 << PRECISION) - 1, 1 << (PRECISION - 1), 1 << 32


_Model = tuple[list[int], list[int]]
"""The probabilities, and the bits seen, of prefix[0..31] and second[0..31]."""


def _new_models() -> defaultdict[Hashable, _Model]:
    """Number models by name, made when they are first used."""
    return defaultdict(lambda: ([_EVEN] * (2 * MAX_LENGTH + 2), [0] * (2 * MAX_LENGTH + 2)))


def _adapt(model: _Model, place: int, bit: int) -> None:
    """Move the probability of a bit model towards the bit that it saw."""
    probabilities, seen = model
    p, n = probabilities[place], seen[place] + 2
    probabilities[place] = p - p // n if bit else p + (_ONE - p) // n
    if n < _MOST_SEEN + 2:
        seen[place] = n - 1


class NumberReader:
    """Reads the numbers of a block.

    Args:
        field: what errors call it.
        trace: hears which numbers are which field.
        allowed: takes numbers from what is allowed.

    Attributes:
        position: numbers read so far.

    Raises:
        Malformed: ``rans-length``, ``rans-last-word``.
    """

    def __init__(
        self, data: bytes, field: str, trace: Trace | None = None, allowed: Spend = lambda count: True
    ) -> None:
        self._words: list[int] = words_of(data).tolist()
        self._allowed = allowed
        self.field, self.trace, self.position = field, trace, 0
        self._models, self._state = _new_models(), 0
        self._refill()
        self._refill()

    def spend(self, count: int) -> None:
        """Take `count` numbers, which are to be read, from what is allowed.

        Raises:
            LimitExceeded: ``limit-expansion``.
        """
        if not self._allowed(count):
            message = "more numbers than this reader allows: raise its limit if you trust the file"
            raise LimitExceeded("limit-expansion", message, field=self.field)

    def number(self, name: Hashable) -> int:
        """The next number, 0 to `LARGEST`, with the number model of a name.

        Raises:
            Malformed: ``bad-number`` for one of more bits.
        """
        model = self._models[name]
        length = 0
        while self._bit(model, length):
            length += 1
            if length > MAX_LENGTH:
                raise Malformed("bad-number", "a number of more than 32 bits (SPEC §8.5)", field=self.field)
        value = 1
        if length:
            value = 2 + self._bit(model, MAX_LENGTH + 1 + length)
            for _ in range(length - 1):
                value = 2 * value + self._symbol(_HALF)
        self.position += 1
        return value - 1

    def finish(self) -> None:
        """Check the end state (SPEC §8.2).

        Raises:
            Malformed: ``rans-seal``.
        """
        if self._state or self._words:
            raise Malformed("rans-seal", "numbers do not end in the empty state: they are damaged", field=self.field)

    def _bit(self, model: _Model, place: int) -> int:
        bit = self._symbol(model[0][place] << _UNIT)
        _adapt(model, place, bit)
        return bit

    def _symbol(self, past: int) -> int:
        """Symbol 0 or 1, with `past` the frequency of 0."""
        slot, upper = self._state & _SLOT, self._state >> PRECISION
        if slot < past:
            self._state = past * upper + slot
        else:
            self._state = (_SLOT + 1 - past) * upper + slot - past
        if self._state < _WORD:
            self._refill()
        return int(slot >= past)

    def _refill(self) -> None:
        if self._state < _WORD and self._words:
            self._state = self._state << 32 | self._words.pop()


class NumberWriter:
    """Writes the numbers of a block: the inverse of :class:`NumberReader`."""

    def __init__(self) -> None:
        self._models = _new_models()
        self._spans: list[tuple[int, int]] = []

    def number(self, name: Hashable, value: int) -> None:
        """Append a number, 0 to `LARGEST`, with the number model of a name."""
        model, value = self._models[name], value + 1
        length = value.bit_length() - 1
        for place in range(length):
            self._bit(model, place, 1)
        self._bit(model, length, 0)
        if length:
            self._bit(model, MAX_LENGTH + 1 + length, value >> (length - 1) & 1)
        for place in range(length - 2, -1, -1):
            self._append(_HALF, value >> place & 1)

    def finish(self) -> bytes:
        """The block."""
        encoder = RansEncoder()
        if self._spans:
            encoder.append(*np.array(self._spans, np.int64).T)
        return encoder.finish()

    def _bit(self, model: _Model, place: int, bit: int) -> None:
        self._append(model[0][place] << _UNIT, bit)
        _adapt(model, place, bit)

    def _append(self, past: int, bit: int) -> None:
        self._spans.append((past, _SLOT + 1) if bit else (0, past))
