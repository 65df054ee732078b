"""Rice codes, shifted or not: what is packed comes back, and nothing else is accepted."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scarfmt.container.bytefields import ByteReader
from scarfmt.entropy.rice import MAX_QUOTIENT, pack_rice, pack_shifted, unpack_rice, unpack_shifted
from scarfmt.errors import ScarError
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


@given(st.lists(st.integers(-300, 300), max_size=200))
def test_small_values_come_back(values: list[int]) -> None:
    """With whatever parameter is best for them."""
    assert read(pack_rice(np.array(values, np.int64)), len(values)) == values


@given(st.integers(-(2**31) + 1, 2**31 - 1), st.integers(1, 5))
def test_large_values_come_back(value: int, count: int) -> None:
    """Up to 31 bits and a sign."""
    assert read(pack_rice(np.full(count, value, np.int64)), count) == [value] * count


def test_the_layout_is_that_of_the_specification() -> None:
    """Quotients of all values first, then low bits, each part filled up with zeros."""
    # z = 0, 1, 6, 3 with k = 1: quotients 0, 0, 3, 1 and low bits 0, 1, 0, 1.
    assert pack_rice(np.array([0, -1, 3, -2])) == bytes([1, 0b00111010, 0b01010000])
    # Equal sizes for k = 0 and 1: the smaller.
    assert pack_rice(np.array([0, 1]))[0] == 0


@given(VALUES.filter(len))
def test_every_prefix_is_refused(values: list[int]) -> None:
    """No byte is spare."""
    values = [value % 1000 for value in values]
    data = pack_rice(np.array(values))
    for length in range(len(data)):
        with pytest.raises(ScarError):
            read(data[:length], len(values))


@pytest.mark.parametrize(
    ("data", "count"),
    [
        (bytes([32, 0, 0, 0, 0, 0, 0]), 1),
        (bytes([0, 0b01000000]), 1),
        (bytes([1, 0b00000000, 0b01000000]), 1),
        (bytes([31, 0b11110000, 0, 0, 0, 0]), 1),
        (bytes([0]) + b"\xff" * 32, 1),
        (bytes([0]) + b"\xff" * 40 + b"\0", 2),
    ],
)
def test_what_breaks_the_rule_is_refused(data: bytes, count: int) -> None:
    """A parameter above 31, fill bits of either part, a value of more than 32 bits, long quotients."""
    refuses("bad-rice", lambda: read(data, count))


@pytest.mark.parametrize("count", [1, 2, 9])
def test_ones_without_end_are_short_or_too_many(count: int) -> None:
    """Too many as soon as as many bytes are there as the quotients can take (SPEC §5.9)."""
    most = count * (MAX_QUOTIENT + 1) // 8
    refuses("payload-short", lambda: read(b"\0" + b"\xff" * (most - 1), count))
    refuses("bad-rice", lambda: read(b"\0" + b"\xff" * most, count))
    refuses("bad-rice", lambda: read(b"\0" + b"\xff" * (most + 9) + b"\0" * count, count))


def test_a_payload_that_ends_in_the_quotients_is_short_whatever_they_are() -> None:
    """All are found before one is checked: a quotient of 256, then too few bits."""
    long = b"\0" + b"\xff" * 32
    refuses("payload-short", lambda: read(long + b"\x7f", 2))
    refuses("bad-rice", lambda: read(long + b"\x3f", 2))


def test_the_largest_quotient_is_readable() -> None:
    """255 ones, also several times."""
    assert read(b"\0" + (b"\xff" * 31 + b"\xfe") * 3, 3) == [-128] * 3


@given(st.lists(st.integers(-(2**12), 2**12), max_size=60), st.integers(0, 18))
def test_shifted_numbers_come_back(values: list[int], shift: int) -> None:
    """With their common zero bits left out: no byte more than the numbers without them."""
    numbers = np.array(values, np.int64) << shift
    data = pack_shifted(numbers)
    assert read_shifted(data, len(values)) == numbers.tolist()
    assert len(data) <= 1 + len(pack_rice(np.array(values, np.int64)))


def test_the_layout_of_shifted_numbers_is_that_of_the_specification() -> None:
    """The largest shift, then a Rice code; 0 where there is nothing to shift."""
    assert pack_shifted(np.array([0, -8, 24, -16])) == bytes([3]) + pack_rice(np.array([0, -1, 3, -2]))
    assert pack_shifted(np.array([0, 0])) == bytes([0]) + pack_rice(np.array([0, 0]))
    assert pack_shifted(np.zeros(0, np.int64)) == bytes([0, 0])
    assert read_shifted(bytes([31, 31]), 0) == []


@pytest.mark.parametrize("number", [2**31 - 1, -(2**31) + 1, 1 << 30, -(1 << 30)])
def test_the_largest_shifted_numbers_come_back(number: int) -> None:
    """31 bits and a sign."""
    assert read_shifted(pack_shifted(np.array([0, number])), 2) == [0, number]


@pytest.mark.parametrize(
    ("shift", "value"), [(32, 0), (255, 0), (31, 1), (31, -1), (1, 1 << 30), (0, -(1 << 31)), (31, -(1 << 31))]
)
def test_shifts_out_of_range_are_refused(shift: int, value: int) -> None:
    """A shift above 31, also of zeros; magnitudes of 2^31 and more."""
    m = 2 * value if value >= 0 else -2 * value - 1
    code = bytes([31, 0x80 if m >> 31 else 0]) + ((m & 0x7FFFFFFF) << 1).to_bytes(4, "big")
    assert read(code, 1) == [value]
    refuses("bad-rice", lambda: read_shifted(bytes([shift]) + code, 1))


@given(st.binary(max_size=40), st.integers(0, 50))
def test_garbage_raises_only_our_errors(data: bytes, count: int) -> None:
    """A result or a refusal."""
    try:
        values = read(data, count)
    except ScarError:
        return
    assert len(values) == count
