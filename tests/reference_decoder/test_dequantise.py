"""Exact reconstruction, against the formulas of SPEC §9.1-9.2 in rational arithmetic."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from reference_decoder.dequantise import latents, offset_values, positions, tile_boxes
from scarfmt.codecs.channels import cell_widths, channel_values
from scarfmt.container.directory import Tile, tile_table
from scarfmt.container.morton import interleave
from scarfmt.errors import Malformed
from scarfmt.scene.codebooks import Codebooks
from scarfmt.scene.model import Lattice


@given(st.integers(-(2**31) + 1, 2**31 - 1), st.floats(1e-30, 1e6), st.integers(1, 20))
def test_channel_value_rounds_quotient_product_and_result_once_each(value: int, step: float, steps: int) -> None:
    width = float(Fraction(step) / 3 ** (steps - 1))  # Fraction to float rounds to nearest even
    product = float(Fraction(value) * Fraction(width))
    values = channel_values(np.array([[value]], np.int32), (step,), np.array([steps]))
    assert values.dtype == np.float32
    assert values[0, 0] == np.float32(product)


def test_channel_without_steps_is_zero_and_each_component_has_its_own_step() -> None:
    values = channel_values(np.array([[1, 1], [1, 1], [0, 0]], np.int32), (0.5, 3.0), np.array([1, 2, 0]))
    np.testing.assert_array_equal(values, np.float32([[0.5, 3.0], [0.5 / 3, 1.0], [0, 0]]))


def test_value_beyond_binary32_becomes_infinite_without_a_warning() -> None:
    with np.errstate(all="raise"):
        assert np.isinf(channel_values(np.array([[1 << 30]], np.int32), (1e300,), np.array([1])))
    assert offset_values(np.array([[[2, -3, 0]]], np.int32), (0.5, 1.0, 1.0)).tolist() == [[[1.0, -3.0, 0.0]]]


@given(
    st.tuples(*[st.integers(0, (1 << 32) - 1)] * 3),
    st.integers(11, 21),
    st.integers(0, 20),
    st.floats(1e-20, 1e3),
    st.floats(-1e6, 1e6),
    st.tuples(*[st.integers(-13, 13)] * 3),
)
def test_position_is_the_formula_step_by_step(
    at: tuple[int, int, int], depth: int, shift: int, voxel: float, origin: float, trits: tuple[int, int, int]
) -> None:
    """Lattices of 32 bits, coordinates of 1e6, shifts up to 20: every operation exact or rounded once."""
    shift = min(shift, 32 - depth)
    low = 32 - depth
    prefix = int(interleave(np.array([[c >> low for c in at]]))[0])
    local = np.array([[(c & ((1 << low) - 1)) >> shift for c in at]])
    lattice = Lattice((origin, -origin, 0.0), voxel, 32)
    residual = np.array([trits], np.int32) * cell_widths((1 / 3,) * 3, np.array([3]))
    got = positions(lattice, Tile(depth, shift, prefix), interleave(local), residual)
    for axis in range(3):
        t = Fraction((at[axis] >> shift) << shift) + Fraction(1 << shift, 2)
        inside = float(t + (1 << shift) * Fraction(residual[0, axis]))
        scaled = float(Fraction(voxel) * Fraction(inside))
        assert got[0, axis] == float(Fraction(lattice.origin[axis]) + Fraction(scaled))
    low_corner, high_corner = tile_boxes(lattice, tile_table([Tile(depth, shift, prefix)]))
    assert (low_corner[0] <= got[0]).all()
    assert (got[0] <= high_corner[0]).all()


@pytest.mark.parametrize(("residual", "fits"), [(1.0, True), (-1.0, True), (1.0001, False), (-2.0, False)])
def test_residuals_beyond_one_cell_are_refused(residual: float, fits: bool) -> None:
    lattice, tile = Lattice((0.0, 0.0, 0.0), 1.0, 8), Tile(1, 0, 0)
    arguments = (lattice, tile, np.zeros(1, np.uint64), np.array([[0.0, residual, 0.0]]))
    if fits:
        assert positions(*arguments)[0, 1] == 0.5 + residual
    else:
        with pytest.raises(Malformed) as caught:
            positions(*arguments)
        assert caught.value.refusal == "value-range"


def test_latents_sum_only_the_stages_received_then_add_the_channel() -> None:
    books = Codebooks(np.array([[1, 10], [2, 20]]), np.array([[100, -65536], [300, 65535]]))
    indices = np.array([[1, 0, 1], [1, 1, 1], [0, 1, 1]], np.int16)
    z = latents(books, indices, np.array([0, 1, 3]), None, 2)
    np.testing.assert_array_equal(z, np.float32([[0, 0], [2, 20], [601, 131080]]))
    refined = latents(books, indices, np.array([0, 1, 3]), np.full((3, 2), 0.25, np.float32), 2)
    np.testing.assert_array_equal(refined, z + np.float32(0.25))
    assert latents(None, indices, np.zeros(3, np.int64), None, 4).tolist() == [[0.0] * 4] * 3
