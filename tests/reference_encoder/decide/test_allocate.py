"""Rate-distortion allocation takes what pays, never takes back, and aligns steps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from reference_encoder.decide.allocate import (
    LatentChain,
    aligned_steps,
    classify,
    entropy_bits,
    hull_choice,
    increment,
    plan_channel,
    ranked_with_colour,
)
from reference_encoder.decide.rdo import choose_values
from reference_encoder.tuning import COARSEST_COLOUR
from scarfmt.container.schema import Stream


@given(
    st.lists(st.floats(0.1, 100), min_size=1, max_size=8),
    st.lists(st.floats(0, 50), min_size=1, max_size=8),
    st.floats(1e-3, 1e3),
    st.floats(1, 100),
)
def test_hull_choice_never_takes_back(costs: list[float], gains: list[float], lambda_: float, factor: float) -> None:
    """A smaller lambda never chooses fewer increments."""
    size = min(len(costs), len(gains))
    bits = np.concatenate([[0], np.cumsum(costs[:size])])
    error = 400 - np.concatenate([[0], np.cumsum(gains[:size])])
    assert hull_choice(bits, error, lambda_) <= hull_choice(bits, error, lambda_ / factor)


def test_hull_choice_is_the_minimum() -> None:
    """At a given lambda no other index has a smaller error + lambda * bits."""
    draw = np.random.default_rng(0)
    for _ in range(200):
        bits = np.concatenate([[0], np.cumsum(draw.random(6))])
        error = np.concatenate([[5], 5 - np.cumsum(draw.random(6) * 0.8)])
        lambda_ = float(draw.random() * 3 + 0.01)
        chosen = hull_choice(bits, error, lambda_)
        assert error[chosen] + lambda_ * bits[chosen] <= (error + lambda_ * bits).min() + 1e-9


def test_classify_orders_by_importance_and_drops_the_invisible() -> None:
    """Class 0 is the most important; what does not pay for its bits is dropped; no class is empty."""
    importance = np.array([1e3, 1.0, 0.99, 30.0, 1e-9, 0.0])
    classes, count = classify(importance, 1e-3, 40, 8)
    assert classes[0] == 0
    assert classes[0] <= classes[3] <= classes[1] == classes[2]
    assert classes[4] == classes[5] == -1
    assert set(classes[classes >= 0]) == set(range(count))


def test_classify_keeps_something() -> None:
    """A scene nobody sees still keeps its most visible anchor."""
    classes, count = classify(np.zeros(5), 1e-3, 40, 8)
    assert count == 1
    assert (classes >= 0).any()


def test_importance_with_colour_ranks_between_both_and_drops_the_same() -> None:
    """Half of the colour in the logarithm is the geometric mean, at the scale of absence; who is dropped stays so."""
    absence, colour = np.array([8.0, 2.0, 1e-9, 1.0]), np.array([1.0, 64.0, 5.0, 1.0])
    assert ranked_with_colour(absence, colour, 0.0, 1e-3) is absence
    ranked = ranked_with_colour(absence, colour, 0.5, 1e-3)
    # Of those worth sending: sqrt(8 * 1), sqrt(2 * 64), sqrt(1 * 1), at the geometric mean of absence.
    by_mean = np.array([8.0, 128.0, 1.0]) ** 0.5
    kept = [0, 1, 3]
    np.testing.assert_allclose(ranked[kept] / ranked[3], by_mean / by_mean[2])
    assert np.log(ranked[kept]).mean() == pytest.approx(np.log(absence[kept]).mean())
    assert ranked[2] == absence[2]
    unseen = ranked_with_colour(absence, np.array([1.0, 1.0, 1.0, 0.0]), 0.5, 1e-3)
    assert (unseen > 1e-3).tolist() == (absence > 1e-3).tolist()


def test_entropy_matches_counts() -> None:
    """Four equally likely symbols cost two bits each, plus the tables."""
    symbols = np.tile(np.arange(4), 1000)
    assert entropy_bits(symbols, np.zeros(4000, np.int64)) == 8000 + 4 * 8.0
    assert entropy_bits(symbols, symbols) == 4 * 8.0


def test_aligned_steps_hit_the_best_step() -> None:
    """With equal sensitivities some refinement of the first step is exactly the high-rate optimum."""
    sensitivity = np.full((100, 1), 2.5)
    (step,) = aligned_steps((0.9,), sensitivity, np.zeros(100, np.int64), 1, 1e-4)
    best = np.sqrt(6 * 1e-4 / np.log(2) / 2.5)
    turns = np.log(step / best) / np.log(3)
    assert abs(turns - round(turns)) < 1e-9
    assert 0.9 / 3**0.51 < step < 0.9 * 3**0.51


@given(seed=st.integers(0, 1000), lambda_=st.sampled_from([0.0, 1e-3, 0.1, 10.0]))
def test_rounding_never_raises_the_lagrangian(seed: int, lambda_: float) -> None:
    """Chosen integers are next to the value, are nearest when bits are free, and cost no more in the end."""
    draw = np.random.default_rng(seed)
    scaled = draw.laplace(0, 1, (500, 2))
    weight = draw.random((500, 2)) + 0.1
    chosen = choose_values(scaled, weight, draw.integers(0, 3, 500), lambda_)
    assert np.abs(chosen - scaled).max() <= 1
    if lambda_ == 0:
        assert np.array_equal(chosen, np.rint(scaled))
    elif lambda_ == 10.0:
        assert np.abs(chosen).sum() < np.abs(np.rint(scaled)).sum()


def test_no_layer_has_colours_that_turn_grey() -> None:
    """However dear bits are, cells of colour stay narrow; shapes may be as coarse as they come."""
    draw = np.random.default_rng(4)
    classes, weight = np.zeros(500, np.int64), np.full((500, 3), 1e-9)
    step = (2.2, 2.2, 2.6)
    plans = [
        plan_channel(stream, draw.normal(0, 0.2, (500, 3)), step, weight, classes, 1)
        for stream in (Stream.SCALE, Stream.COLOUR)
    ]
    nothing = LatentChain(0, np.zeros((1, 1)), np.zeros((1, 1)))
    (_, scale, colour, _), _, _ = increment(plans, nothing, 0, 1e9, 1e-9)
    assert scale == 1
    assert COARSEST_COLOUR / 3 < max(step) / 3.0 ** (colour - 1) <= COARSEST_COLOUR * (1 + 1e-9)
