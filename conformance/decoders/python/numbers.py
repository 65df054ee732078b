"""Adaptive numbers (SPEC §8.5), of which TABLES, DECODER_MLP and SCENE_MLP blocks are made."""

from __future__ import annotations

import struct

from conformance.decoders.python.fields import TOTAL, Rans, require

Field = tuple[str | int, ...]
"""Names a number model: the field, and the values of what is in its brackets."""
_SECOND = 32


class Numbers:
    """The numbers of a block. `taken` has all that were read, each with its field."""

    def __init__(self, block: bytes) -> None:
        self.rans = Rans(block, {})
        self.taken: list[tuple[Field, int]] = []
        self._models: dict[Field, list[list[int]]] = {}

    def number(self, *field: str | int) -> int:
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

    def signed(self, *field: str | int) -> int:
        u = self.number(*field)
        return u // 2 if u % 2 == 0 else -(u // 2) - 1

    def f32(self, *field: str | int) -> float:
        return float(struct.unpack("<f", struct.pack("<I", self.number(*field)))[0])

    def seal(self) -> None:
        self.rans.seal()
