"""The compiled descent finds laws that are known, leaves out inputs without information, and repeats itself exactly."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from numpy.typing import NDArray

from reference_encoder.training.networks.predictor_training import Parameters, descend
from scarfmt.arrays import F32

COUNT, WIDTH, UNITS = 6000, 6, 4


def start(seed: int) -> Parameters:
    """Random hidden units, and an output of 0."""
    draw = np.random.default_rng(seed)
    first, second = draw.normal(0, 0.4, (WIDTH, UNITS)), draw.normal(0, 0.05, (UNITS, 2))
    shapes = first, np.zeros(UNITS), np.zeros((WIDTH, 2)), second, np.zeros(2)
    first, bias, direct, second, offset = (part.astype(np.float32) for part in shapes)
    return first, bias, direct, second, offset


def outputs(found: Parameters, x: F32) -> NDArray[np.float64]:
    """(n, 2) of the network."""
    first, bias, direct, second, offset = found
    return np.asarray(x @ direct + np.maximum(x @ first + bias, 0) @ second + offset, np.float64)


def inputs(seed: int) -> F32:
    return np.random.default_rng(seed).normal(0, 1, (COUNT, WIDTH)).astype(np.float32)


def logistic_targets(x: F32) -> F32:
    """Whole numbers round 5 |x0| + 3 x1, wider where x2 is large."""
    law = np.random.default_rng(9).logistic(5 * np.abs(x[:, 0]) + 3 * x[:, 1], np.exp(0.5 + 0.5 * x[:, 2]))
    return np.rint(law).astype(np.float32)


def test_mean_and_spread_of_a_logistic_law_are_found() -> None:
    """A bend needs the hidden units, a slope does not, and the second output gives the spread."""
    x = inputs(1)
    found = outputs(descend(start(2), x, logistic_targets(x), False, 0.0, 600, 3), x)
    assert np.abs(found[:, 0] - 5 * np.abs(x[:, 0]) - 3 * x[:, 1]).mean() < 0.7
    assert np.abs(found[:, 1] - 0.5 - 0.5 * x[:, 2]).mean() < 0.25


def test_log_odds_of_ternary_steps_are_found() -> None:
    """P(+1) / P(-1) = exp(2 one), P(0) weighs exp(two): as `predictor_net` cuts them."""
    x = inputs(4)
    one, two = 1.5 * x[:, 0], 1 + x[:, 1]
    weights = np.exp(np.stack([-one, two, one], axis=1))
    edges = np.cumsum(weights / weights.sum(axis=1, keepdims=True), axis=1)
    drawn = (np.random.default_rng(5).random((COUNT, 1)) > edges).sum(axis=1) - 1
    found = outputs(descend(start(6), x, drawn.astype(np.float32), True, 0.0, 600, 7), x)
    assert np.abs(found[:, 0] - one).mean() < 0.2
    assert np.abs(found[:, 1] - two).mean() < 0.2


def test_what_weights_cost_keeps_idle_ones_small() -> None:
    """Inputs without information lose their weights; the law is still found."""
    x = inputs(1)
    free, dear = (descend(start(2), x, logistic_targets(x), False, cost, 600, 3) for cost in (0.0, 0.01))
    for part in (0, 2):  # first and direct
        assert np.abs(dear[part][3:]).max() < 0.5 * np.abs(free[part][3:]).max()
    assert np.abs(outputs(dear, x)[:, 0] - 5 * np.abs(x[:, 0]) - 3 * x[:, 1]).mean() < 1


@pytest.mark.parametrize("ternary", [False, True])
def test_the_same_seed_gives_the_same_network_whatever_else_runs(ternary: bool) -> None:
    """The network is equal even beside another descent on another thread; another seed gives another network."""
    x = inputs(8)
    targets = np.sign(x[:, 0]).astype(np.float32)

    def run(seed: int) -> Parameters:
        return descend(start(1), x, targets, ternary, 0.001, 60, seed)

    alone = run(3)
    with ThreadPoolExecutor(2) as pool:
        pair = list(pool.map(run, (3, 4)))
    assert all(np.array_equal(one, other) for one, other in zip(alone, pair[0], strict=True))
    assert not np.array_equal(alone[0], pair[1][0])
