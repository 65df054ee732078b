"""Rice codes, shifted or not: what is packed comes back, and nothing else is accepted."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from scarfmt.container.bytefields import ByteReader
from scarfmt.entropy.rice import MAX_PARAMETER, MAX_QUOTIENT, pack_rice, pack_shifted, unpack_rice, unpack_shifted
from tests.samples.codec_samples import refuses

VALUES = st.lists(st.integers(-300, 300) | st.integers(-(2**31) + 1, 2**31 - 1), max_size=60)


def read(data: bytes, count: int) -> list[int]:
    reader = ByteReader(data, "rice")
    values = [int(value) for value in unpack_rice(reader, count)]
    reader.finish()
    return values


def read_shifted(data: bytes, count: int) -> list[int]:
    reader = ByteReader(data, "rice")
    numbers = [int(number) for number in unpack_shifted(reader, count)]
    reader.finish()
    return numbers


def test_the_layout_is_that_of_the_specification() -> None:
    """Quotients of all values first, then low bits, each part filled up with zeros."""
    # z = 0, 1, 6, 3 with k = 1: quotients 0, 0, 3, 1 and low bits 0, 1, 0, 1.
    assert pack_rice(np.array([0, -1, 3, -2])) == bytes([1, 0b00111010, 0b01010000])
    # Equal sizes for k = 0 and 1: the smaller.
    assert pack_rice(np.array([0, 1]))[0] == 0


@pytest.mark.parametrize("count", [1, 2, 9])
def test_ones_without_end_are_short_or_too_many(count: int) -> None:
    """Too many as soon as as many bytes are there as the quotients can take (SPEC §5.9)."""
    most = count * (MAX_QUOTIENT + 1) // 8
    refuses("payload-short", lambda: read(b"\0" + b"\xff" * (most - 1), count))
    refuses("bad-rice", lambda: read(b"\0" + b"\xff" * most, count))
    refuses("bad-rice", lambda: read(b"\0" + b"\xff" * (most + 9) + b"\0" * count, count))


@given(st.lists(st.integers(-(2**12), 2**12), max_size=60), st.integers(0, 18))
def test_shifted_numbers_come_back(values: list[int], shift: int) -> None:
    """With their common zero bits left out: no byte more than the numbers without them."""
    numbers = np.array(values, np.int64) << shift
    data = pack_shifted(numbers)
    assert read_shifted(data, len(values)) == numbers.tolist()
    assert len(data) <= 1 + len(pack_rice(np.array(values, np.int64)))


@given(st.lists(st.integers(-3000, 3000) | st.integers(-(1 << 31) + 1, (1 << 31) - 1), max_size=40))
@example([32767] + 400 * [0])
def test_the_parameter_of_a_rice_code_is_the_cheapest(values: list[int]) -> None:
    """R-5.9-4: fewest bits, the smallest of equals."""
    mapped = [2 * value if value >= 0 else -2 * value - 1 for value in values]
    allowed = [k for k in range(MAX_PARAMETER + 1) if all(m >> k <= MAX_QUOTIENT for m in mapped)]
    bits = {k: len(mapped) * (1 + k) + sum(m >> k for m in mapped) for k in allowed}
    assert pack_rice(np.array(values, np.int64))[0] == min(allowed, key=lambda k: (bits[k], k))


@given(st.lists(st.integers(-5, 5), max_size=6), st.integers(0, 28))
def test_the_shift_is_the_largest(values: list[int], power: int) -> None:
    """R-5.9-5: the power of two that divides all numbers, 0 if all are 0."""
    numbers = [value << power for value in values]
    expected = max((s for s in range(32) if all(n % (1 << s) == 0 for n in numbers)), default=0) if any(numbers) else 0
    assert pack_shifted(np.array(numbers, np.int64))[0] == expected
