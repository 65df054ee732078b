"""Morton codes against the definition, bit by bit."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from scarfmt.container.morton import MAX_BITS, deinterleave, interleave

COORDINATE = st.integers(0, (1 << MAX_BITS) - 1)


def by_definition(point: tuple[int, ...]) -> int:
    """x in bit 0, y in bit 1, z in bit 2 of each triple."""
    return sum((value >> bit & 1) << (3 * bit + axis) for axis, value in enumerate(point) for bit in range(MAX_BITS))


@given(st.lists(st.tuples(COORDINATE, COORDINATE, COORDINATE), max_size=20))
def test_codes_are_the_definition_and_come_back(points: list[tuple[int, int, int]]) -> None:
    """Any coordinates of up to 21 bits."""
    coordinates = np.array(points, np.int64).reshape(-1, 3)
    codes = interleave(coordinates)
    assert codes.tolist() == [by_definition(point) for point in points]
    assert deinterleave(codes).tolist() == coordinates.tolist()
