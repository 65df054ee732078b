"""Rate-distortion curves: what pays is taken and never taken back, and steps are aligned."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from reference_encoder.rdo import curves
from reference_encoder.rdo.curves import (
    RdCurve,
    StepChoices,
    align_steps,
    entropy_bits,
    measure_curve,
    predict_lambda,
)
from reference_encoder.tuning import COARSEST_COLOUR, FINEST_STEP, LAMBDA_QUALITY_DB, LAMBDA_SLOPE
from scarfmt.arrays import F64
from scarfmt.container.schema import Stream


def hull_choice(bits: F64, error: F64, lambda_: float) -> int:
    """Steps that a lambda takes of one optional channel of one class."""
    padded = (np.pad(values, (0, FINEST_STEP + 1 - len(values)), "edge")[None] for values in (bits, error))
    steps, _, _ = StepChoices.of([RdCurve(Stream.LATENT, (1.0,), *padded)]).at(lambda_, lambda_)
    return int(steps[0, 0])


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


def test_in_the_last_layer_every_class_receives_what_pays() -> None:
    """Channels and classes of equal curves have equal steps at its lambda; in layers before, not all at once."""
    bits = np.tile(np.arange(FINEST_STEP + 1.0), (2, 1))
    curves = [RdCurve(stream, (1.0,), bits, 0.5**bits) for stream in (Stream.LATENT, Stream.POSITION_RESIDUAL)]
    choices, last = StepChoices.of(curves), 0.5**5.5
    assert np.unique(choices.at(last, last)[0]).tolist() == [5]
    assert len(np.unique(choices.at(4 * last, last)[0])) == 2


def test_parts_of_a_class_cost_and_err_as_the_whole() -> None:
    """A class that is split has the bits and the error it had, in its part and in its rest."""
    draw = np.random.default_rng(1)
    curve = RdCurve(Stream.SCALE, (1.0,), draw.random((3, FINEST_STEP + 1)), draw.random((3, FINEST_STEP + 1)))
    parts = curve.split((1.0, 0.25))
    np.testing.assert_allclose(parts.bits, np.array([1, 0.25, 0.75, 1])[:, None] * curve.bits[[0, 1, 1, 2]])
    np.testing.assert_allclose(parts.error.sum(axis=0), curve.error.sum(axis=0))


def curve_of(values: F64, classes: list[int], repeat: float = 1.0) -> RdCurve:
    """The curve of logarithms of unit weight."""
    of, step = np.repeat(np.arange(len(classes)), classes), (1.0,) * values.shape[1]
    return measure_curve(Stream.SCALE, values, step, np.ones(values.shape), of, len(classes), repeat)


def test_a_sample_stands_for_its_class(monkeypatch: pytest.MonkeyPatch) -> None:
    values = np.random.default_rng(3).normal(size=(2200, 1))
    whole, twice = (curve_of(values, [2000, 200], repeat) for repeat in (1.0, 2.0))
    np.testing.assert_allclose(twice.error, 2 * whole.error)
    monkeypatch.setattr(curves, "PLANNED_ANCHORS", 500)
    np.testing.assert_allclose(curve_of(values, [2000, 200]).error, whole.error, rtol=0.2)


def test_too_long_errs_more_than_too_short_and_a_component_tells_of_the_next() -> None:
    (long, _), (short, _) = (curve_of(np.full((9, 1), value), [9]).error[:, 1:3].T for value in (0.6, 0.4))
    assert long > 1.4 * short
    values = np.random.default_rng(3).normal(size=(4000, 1)) * 3
    assert curve_of(np.tile(values, 2), [4000]).bits[0, 1] < 1.2 * curve_of(values, [4000]).bits[0, 1]


def test_lambda_falls_with_quality_and_count() -> None:
    lambda_ = predict_lambda(LAMBDA_QUALITY_DB, 1000, 20.0)
    assert lambda_ == pytest.approx(1e-5)
    assert predict_lambda(LAMBDA_QUALITY_DB + 10 * LAMBDA_SLOPE, 1000, 20.0) == pytest.approx(1e-6)


def test_entropy_matches_counts() -> None:
    """Four equally likely symbols cost two bits each, plus the tables; every class has its own."""
    symbols, classes = np.tile(np.arange(4), 1000), np.repeat([0, 2], 2000)
    one, nothing = np.zeros(4000, np.int64), np.zeros(4000, np.int64)
    assert entropy_bits(symbols, nothing, 1, one, np.ones(1)).tolist() == [8000 + 4 * 8.0]
    assert entropy_bits(symbols, symbols, 4, one, np.ones(1)).tolist() == [4 * 8.0]
    assert entropy_bits(symbols, nothing, 1, classes, np.array([1.0, 1.0, 3.0])).tolist() == [4032.0, 0.0, 12032.0]
    assert entropy_bits(symbols * 10**9, nothing, 1, one, np.ones(1)).tolist() == [8000 + 4 * 8.0]


def test_aligned_steps_hit_the_best_step() -> None:
    """With equal sensitivities some refinement of the first step is exactly the high-rate optimum."""
    sensitivity = np.full((100, 1), 2.5)
    (step,) = align_steps((0.9,), sensitivity, np.zeros(100, np.int64), 1, 1e-4)
    best = np.sqrt(6 * 1e-4 / np.log(2) / 2.5)
    turns = np.log(step / best) / np.log(3)
    assert abs(turns - round(turns)) < 1e-7
    assert 0.9 / 3**0.51 < step < 0.9 * 3**0.51


def test_no_layer_has_colours_that_turn_grey() -> None:
    """However dear bits are, cells of colour stay narrow; shapes may be as coarse as they come."""
    draw = np.random.default_rng(4)
    classes, weight = np.zeros(500, np.int64), np.full((500, 3), 1e-9)
    step = (2.2, 2.2, 2.6)
    curves = [
        measure_curve(stream, draw.normal(0, 0.2, (500, 3)), step, weight, classes, 1)
        for stream in (Stream.SCALE, Stream.COLOUR)
    ]
    (scale,), (colour,) = StepChoices.of(curves).at(1e9, 1e-9)[0]
    assert scale == 1
    assert COARSEST_COLOUR / 3 < max(step) / 3.0 ** (colour - 1) <= COARSEST_COLOUR * (1 + 1e-9)
