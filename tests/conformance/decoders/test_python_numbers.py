"""Adaptive numbers of the readable decoder against those of the package, on streams that nobody wrote."""

from __future__ import annotations

import random

from conformance.decoders.python.fields import Refused
from conformance.decoders.python.numbers import Numbers
from scarfmt.entropy.numbers import NumberReader
from scarfmt.errors import ScarError


def readable(data: bytes, names: list[int]) -> list[int | str]:
    """The numbers, and the refusal that ends them."""
    out: list[int | str] = []
    try:
        numbers = Numbers(data)
        for name in names:
            out.append(numbers.number(name))
        numbers.seal()
    except Refused as error:
        out.append(str(error))
    return out


def of_the_package(data: bytes, names: list[int]) -> list[int | str]:
    out: list[int | str] = []
    try:
        reader = NumberReader(data, "test")
        for name in names:
            out.append(reader.number(name))
        reader.finish()
    except ScarError as error:
        out.append(error.refusal)
    return out


def test_any_words_give_the_same_numbers_or_refusals() -> None:
    """Words without a bit 0 give a prefix that is too long."""
    chance, seen = random.Random(8), set[int | str]()
    for _ in range(300):
        least = chance.choice((0, chance.getrandbits(32), 0xFFFFFFFF))
        words = [chance.getrandbits(32) | least for _ in range(12)]
        data = b"".join(word.to_bytes(4, "little") for word in words[: chance.randrange(12)])
        data += chance.choice((b"", b"", bytes(4), b"\1"))
        names = [chance.randrange(3) for _ in range(40)]
        found = readable(data, names)
        assert found == of_the_package(data, names)
        seen |= set(found)
    assert {"bad-number", "rans-seal", "rans-length", "rans-last-word"} <= seen
