"""Products of 16-bit pairs by every kind of vectors: sums and roundings of the definition, at its bounds (§10.1)."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from scarfmt.arrays import I64
from scarfmt.kernel.words import PackedLayers, paired
from scarfmt.neural.arithmetic import ACCUMULATOR_LIMIT, MAX_SHIFT, MAX_WEIGHT, Linear, half_step
from tests.kernel.channel_cases import Case
from tests.kernel.samples import SEEDS, both, library, needs_kernel, same

pytestmark = needs_kernel

BLOCK = 16
KINDS = ("AVX-512 VNNI", "AVX-VNNI", "AVX2", "plain")
# The kinds that a test is run with are set once, outside the examples.
FIXED = settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.fixture(params=range(len(KINDS)), ids=KINDS)
def kind(request: pytest.FixtureRequest) -> Iterator[str]:
    """The library with one kind of products, skipped where the processor has it not."""
    wanted = KINDS[request.param]
    found = library().scar_products(request.param).decode()
    if found == wanted:
        yield wanted
    library().scar_products(0)
    if found != wanted:
        pytest.skip(f"{found} here")


def computed(linear: Linear, x: I64, low: int, high: int) -> I64:
    """(n, outputs) of (n, inputs) activations, n a multiple of BLOCK."""
    memory = PackedLayers()
    layer = memory.layer(linear.weights, linear.biases, linear.shift, low, high)
    blocks = len(x) // BLOCK
    words = np.ascontiguousarray(paired(x).reshape(blocks, BLOCK, -1).transpose(0, 2, 1))
    out = np.zeros((blocks, layer.rows, BLOCK), np.int32)
    library().scar_layer(ctypes.byref(layer), words.ctypes.data, blocks, out.ctypes.data)
    return out.transpose(0, 2, 1).reshape(len(x), -1)[:, : linear.outputs].astype(np.int64)


def extreme_layer(rng: np.random.Generator, rows: int, columns: int, shift: int, amax: int) -> Linear:
    """Weights of any size, in many rows as large as they may be; biases that fill what is left up to the bound."""
    top = np.minimum(MAX_WEIGHT, np.exp2(rng.uniform(0, 15, (rows, 1))).astype(np.int64))
    weights = rng.integers(-1, 2, (rows, columns)) * top
    left = ACCUMULATOR_LIMIT - 1 - half_step(shift)
    for row in weights:
        while np.abs(row).sum() * amax > left:
            row[rng.integers(columns)] //= 3
    room = left - np.abs(weights).sum(axis=1) * amax
    biases = np.where(rng.random(rows) < 0.5, room * rng.integers(-1, 2, rows), rng.integers(-room, room + 1))
    linear = Linear(weights.astype(np.int32), biases, shift)
    linear.check(amax)
    return linear


@FIXED
@given(
    SEEDS,
    st.integers(1, 70),
    st.integers(1, 255),
    st.sampled_from([0, 1, 7, 12, MAX_SHIFT - 1]),
    st.sampled_from([127, 511, 2047]),
)
@example(0, 1, 1, 0, 511)
@example(1, 66, 255, MAX_SHIFT - 1, 511)
@example(2, 8, 1, 0, 2047)
def test_layers_at_the_bounds(kind: str, seed: int, rows: int, columns: int, shift: int, amax: int) -> None:
    """Any even and odd size, one row, one column; sums of both signs up to 2^24 - 1."""
    rng = np.random.default_rng(seed)
    linear = extreme_layer(rng, rows, columns, shift, amax)
    signs = np.sign(linear.weights[rng.integers(rows, size=2 * BLOCK)]) * amax
    x = np.where(rng.random((2 * BLOCK, 1)) < 0.7, signs, rng.integers(-amax, amax + 1, (2 * BLOCK, columns)))
    sums = x.astype(np.int64) @ linear.weights.T.astype(np.int64) + linear.biases + half_step(shift)
    assert (np.abs(sums) < ACCUMULATOR_LIMIT).all()
    assert np.array_equal(computed(linear, x, -(1 << 25), 1 << 25), sums >> shift)
    assert np.array_equal(computed(linear, x, -amax, amax), linear.signed(x, amax))
    assert np.array_equal(computed(linear, x, 0, amax), linear.relu(x, amax))


def test_a_shift_of_24(kind: str) -> None:
    """All but the half of the rounding is lost; a layer may have it, though its sums then give no more than 0."""
    linear = Linear(np.array([[1], [-1], [0]], np.int32), np.array([0, 0, (1 << 23) - 1]), MAX_SHIFT)
    linear.check(511)
    x = np.full((BLOCK, 1), 511)
    assert np.array_equal(computed(linear, x, -511, 511), linear.signed(x, 511))
    assert np.array_equal(computed(linear, -x, -511, 511), linear.signed(-x, 511))


def test_sums_that_reach_the_bound(kind: str) -> None:
    """2^24 - 1 from the largest weights, and its opposite."""
    weights = np.array([[32767, 64, 1, 0], [-32767, -64, -1, 0]], np.int32)
    biases = np.array([ACCUMULATOR_LIMIT - 1 - 511 * 32832, -(ACCUMULATOR_LIMIT - 1) + 511 * 32832])
    x = np.full((BLOCK, 4), 511)
    found = computed(Linear(weights, biases, 0), x, -(1 << 25), 1 << 25)
    assert (found == [ACCUMULATOR_LIMIT - 1, 1 - ACCUMULATOR_LIMIT]).all()


@FIXED
@given(SEEDS, st.integers(1, 5), st.integers(0, 4), st.integers(0, 64))
def test_predictors(kind: str, seed: int, components: int, depths: int, units: int) -> None:
    """Contexts, and so all values, with each kind of products; any number of hidden units."""
    assert same(*both(Case(seed, components, depths, 1.0, 0.0, crowd=80, units=units).read))


@given(SEEDS, st.integers(1, 9), st.integers(0, 9))
def test_pairs_in_words(seed: int, rows: int, columns: int) -> None:
    """The first number lies in the lower half; the last of an odd row is beside 0."""
    numbers = np.random.default_rng(seed).integers(-MAX_WEIGHT, MAX_WEIGHT + 1, (rows, columns))
    words = paired(numbers)
    halves = np.stack([words.astype(np.int16), words >> 16], axis=2).reshape(rows, -1)
    assert halves.shape[1] == columns + columns % 2
    assert np.array_equal(halves[:, :columns], numbers)
    assert not halves[:, columns:].any()
