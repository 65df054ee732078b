"""Exact values against the formulas of SPEC §9.1-9.2 in rational arithmetic; float32 within tolerance of float64."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from fuzz.testing.scenes import random_scene
from reference_decoder.decode import decode
from reference_decoder.reconstruct import positions
from reference_decoder.region import tile_boxes
from scarfmt.codecs.channels import cell_widths, channel_values, in_binary32
from scarfmt.coding.writer import write_scene
from scarfmt.container.directory import Tile, tile_table
from scarfmt.container.morton import interleave
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.scene.model import Lattice

TOLERANCE = 1e-5


@given(st.integers(-(2**31) + 1, 2**31 - 1), st.floats(1e-30, 1e6), st.integers(1, 20))
def test_channel_value_rounds_quotient_product_and_result_once_each(value: int, step: float, steps: int) -> None:
    width = float(Fraction(step) / 3 ** (steps - 1))  # Fraction to float rounds to nearest even
    product = float(Fraction(value) * Fraction(width))
    values = channel_values(np.array([[value]], np.int32), (step,), np.array([steps]))
    assert values.dtype == np.float32
    assert values[0, 0] == np.float32(product)


def test_value_beyond_binary32_becomes_infinite_without_a_warning() -> None:
    with np.errstate(all="raise"):
        assert np.isinf(channel_values(np.array([[1 << 30]], np.int32), (1e300,), np.array([1])))
    assert in_binary32(np.array([[[2, -3, 0]]], np.int32), np.array((0.5, 1.0, 1.0))).tolist() == [[[1.0, -3.0, 0.0]]]


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


def test_float32_is_within_tolerance_of_float64() -> None:
    for seed in range(12):
        decoded = decode(write_scene(random_scene(seed, anchors=400)))
        fast, exact = decoded.scene, decoded.activated(np.float64)
        assert isinstance(fast, GaussianScene)
        assert isinstance(exact, GaussianScene)
        assert exact.sh.dtype == np.float64
        assert fast.positions.tobytes() == exact.positions.tobytes()
        for name in ("log_scales", "rotations", "opacity_logits", "sh"):
            a, b = getattr(fast, name), getattr(exact, name)
            assert a.dtype == np.float32
            assert (np.abs(a - b) <= TOLERANCE * np.maximum(1, np.abs(b))).all(), name


def test_scene_has_the_degree_of_the_file_also_before_any_latent() -> None:
    for degree in range(4):
        data = write_scene(random_scene(9, sh_degree=degree, layers=4))
        for layers in range(1, 5):
            scene = decode(data, layers=layers).scene
            assert isinstance(scene, GaussianScene)
            assert scene.sh_degree == degree
