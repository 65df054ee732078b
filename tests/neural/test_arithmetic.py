"""Exact linear layers: float32 is the integers up to the very bound, and what lies above is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from scarfmt.errors import Malformed
from scarfmt.neural.arithmetic import MAX_SHIFT, Linear, amplitude, check_rows, half_step, round_shift
from tests.samples.codec_samples import refuses


@given(st.integers(-(2**40), 2**40), st.integers(0, MAX_SHIFT))
@example(-3, 1)
@example(3, 1)
@example(5, 0)
def test_round_shift_is_the_nearest_integer_ties_up(value: int, shift: int) -> None:
    """Compared in whole numbers: result - 1/2 <= value / 2^shift < result + 1/2, with ties to the larger."""
    found = int(round_shift(np.array([value]), shift)[0])
    assert (2 * found - 1) << shift <= 2 * value < (2 * found + 1) << shift


def filled(rng: np.random.Generator, out: int, columns: int, amax: int, shift: int) -> Linear:
    """A layer whose every row reaches exactly 2^24 - 1 with its rounding, by weights alone or with a bias."""
    top = min(32767, (2**24 - 1 - half_step(shift)) // (amax * columns))
    weights = rng.integers(-top, top + 1, (out, columns)).astype(np.int32)
    room = 2**24 - 1 - half_step(shift) - np.abs(weights.astype(np.int64)).sum(axis=1) * amax
    return Linear(weights, room * rng.choice([-1, 1], out), shift)


@given(st.integers(0, 2**32 - 1), st.integers(8, 12), st.integers(0, 23), st.integers(1, 70))
def test_layers_at_the_bound_compute_the_integers(seed: int, bits: int, shift: int, columns: int) -> None:
    """Random inputs, and those that drive an accumulator to its extreme, at every shift."""
    rng = np.random.default_rng(seed)
    amax = amplitude(bits)
    layer = filled(rng, 5, columns, amax, shift)
    layer.check(amax)
    signs = np.sign(layer.weights) * np.sign(layer.biases)[:, None]
    x = np.concatenate([rng.integers(-amax, amax + 1, (20, columns)), signs * amax, -signs * amax])
    exact = round_shift(x @ layer.weights.T.astype(np.int64) + layer.biases, shift)
    assert layer.round(x).tolist() == exact.tolist()
    assert layer.signed(x, amax).tolist() == np.clip(exact, -amax, amax).tolist()
    assert layer.relu(x, amax).tolist() == np.clip(exact, 0, amax).tolist()


@given(st.integers(0, 2**32 - 1), st.integers(8, 12), st.integers(0, 23))
def test_one_more_than_the_bound_is_refused(seed: int, bits: int, shift: int) -> None:
    """A bias larger by 1, in one row."""
    layer = filled(np.random.default_rng(seed), 3, 4, amplitude(bits), shift)
    biases = layer.biases + np.where(np.arange(3) == 1, np.where(layer.biases < 0, -1, 1), 0)
    refused(Linear(layer.weights, biases, shift), amplitude(bits))


def refused(layer: Linear, amax: int = 511, refusal: str = "bad-network") -> None:
    refuses(refusal, lambda: layer.check(amax, refusal), kind=Malformed)


def test_the_limit_can_be_another() -> None:
    """Half of it, as for the two products of a recurrent layer."""
    check_rows(np.array([[3]]), np.array([2**23 - 1 - 300]), 100, 0, limit=1 << 23)
    with pytest.raises(Malformed):
        check_rows(np.array([[3]]), np.array([2**23 - 300]), 100, 0, limit=1 << 23)
