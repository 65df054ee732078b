"""Morton codes against the definition, bit by bit."""

from __future__ import annotations

import numpy as np
import pytest
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


@pytest.mark.parametrize("kind", [np.uint8, np.int16, np.uint32, np.int64, np.uint64])
def test_codes_do_not_depend_on_the_integer_type(kind: type) -> None:
    """Narrow coordinates do not lose their high bits on the way."""
    points = [(127, 0, 1), (5, 99, 64)]
    assert interleave(np.array(points).astype(kind)).tolist() == list(map(by_definition, points))


@given(st.lists(st.integers(0, (1 << 63) - 1), max_size=20))
def test_every_code_of_63_bits_is_a_point(codes: list[int]) -> None:
    """The map is one to one in the other direction too."""
    assert interleave(deinterleave(np.array(codes, np.uint64))).tolist() == codes


def test_order_is_that_of_the_octree() -> None:
    """All codes of a cube lie between its first and last."""
    points = np.stack(np.meshgrid(*[np.arange(8)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    codes = interleave(points)
    assert sorted(codes.tolist()) == list(range(512))
    octant = points // 4
    for corner in np.unique(octant, axis=0):
        inside = np.sort(codes[(octant == corner).all(axis=1)])
        assert int(inside[-1] - inside[0]) == 63
