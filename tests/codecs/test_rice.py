"""Rice codes: what is packed comes back, and nothing else is accepted."""

from __future__ import annotations

import numpy as np
import pytest
from codec_samples import refuses
from hypothesis import given
from hypothesis import strategies as st

from scarfmt.bytefields import ByteReader
from scarfmt.codecs.rice import pack_rice, unpack_rice
from scarfmt.errors import ScarError

VALUES = st.lists(st.integers(-300, 300) | st.integers(-(2**31) + 1, 2**31 - 1), max_size=60)


def read(data: bytes, count: int) -> list[int]:
    reader = ByteReader(data, "rice")
    values = unpack_rice(reader, count).tolist()
    reader.finish()
    return values


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


@given(st.binary(max_size=40), st.integers(0, 50))
def test_garbage_raises_only_our_errors(data: bytes, count: int) -> None:
    """A result or a refusal."""
    try:
        values = read(data, count)
    except ScarError:
        return
    assert len(values) == count
