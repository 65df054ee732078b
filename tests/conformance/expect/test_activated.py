"""The binary64 reference of activated values, against numbers known otherwise."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from conformance.expect.activated import (
    activated,
    colours,
    deviations,
    network,
    quaternions,
    view,
)
from conformance.expect.expectations import expected_layers
from conformance.scenes.made import build, static_plans
from scarfmt.blocks.mlp import Linear, QuantisedMlp


def linear(weights: list[list[int]], scales: list[float], biases: list[float]) -> Linear:
    return Linear(np.array(weights, np.int16), np.array(scales, np.float32), np.array(biases, np.float32))


def test_a_network_and_its_magnitude() -> None:
    """Two layers, by hand; M replaces every weight, bias and input by its magnitude, so that no ReLU cuts."""
    first = linear([[2, -1], [-3, 0]], [0.5, 1], [1, -2])
    second = linear([[1, -4]], [0.25], [-1])
    x = np.array([[1.0, 8.0], [-1.0, 0.0]])
    reference, magnitude = network(QuantisedMlp((first, second)), x, np.abs(x))
    # Hidden: 1 - 4 + 1 and -3 - 2, then -1 + 1 and 3 - 2.
    assert reference.tolist() == [[-1.0], [0.25 * (0 - 4 * 1) - 1]]
    # Hidden magnitudes: 1 + 4 + 1 and 3 + 2, then 1 + 0 + 1 and 3 + 2.
    assert magnitude.tolist() == [[0.25 * (6 + 4 * 5) + 1], [0.25 * (2 + 4 * 5) + 1]]


def test_a_feature_brings_its_own_magnitude() -> None:
    """The error of a feature that cancelled in one network continues in the next."""
    net = QuantisedMlp((linear([[2, 1]], [1], [0]),))
    assert network(net, np.array([[0.0, -3.0]]), np.array([[1e6, 3.0]]))[1].tolist() == [[2e6 + 3]]


@pytest.mark.parametrize(
    ("scale", "bias", "x"),
    [(1.0, 0.0, [1.0, 2e38]), (1e38, 0.0, [1.0, 0.0]), (1.0, 2e38, [1.0, 0.0]), (1.0, 0.0, [1.0, math.inf])],
    ids=["input", "weight", "bias", "infinite"],
)
def test_a_magnitude_is_infinite_if_anything_before_it_may_overflow(scale: float, bias: float, x: list[float]) -> None:
    """The magnitude is infinite even if the value is then multiplied by 0, or made small by the next layer."""
    first, second = linear([[2, 0]], [scale], [bias]), linear([[1]], [1e-30], [0])
    for layers in ((first,), (first, second)):
        assert network(QuantisedMlp(layers), np.array([x]), np.array([x]))[1].tolist() == [[math.inf]]


def test_colours_that_cancel_are_as_uncertain_as_their_terms() -> None:
    """One m for red, green and blue."""
    reference, magnitude = colours(np.array([[1.0, 2.0**24, 2.0**24]]))
    assert reference.tolist() == [[1, 2**24 + 1, 1 - 2**25]]
    assert magnitude.tolist() == [[2**25 + 1] * 3]


def test_deviations_are_as_uncertain_as_q_and_the_result() -> None:
    """b (1 + M); infinite where M is too large, though b is small."""
    reference, magnitude = deviations(np.array([0.0, 2.0, -500.0]), np.zeros(3), np.array([3.0, 0.0, 2e38]))
    np.testing.assert_allclose(reference, [0.5, math.exp(2) / 2, 0], atol=1e-200)
    np.testing.assert_allclose(magnitude, [2, math.exp(2) / 2, math.inf])


def test_quaternions_are_as_uncertain_as_they_are_short() -> None:
    """A quaternion without length and magnitude is the identity and is compared. One shorter than 1e-30 is not
    compared."""
    q = np.array([[3.0, 0, 0, -4], [0, 3e-25, 4e-25, 0], [0, 0, 0, 0], [0, 0, 0, 0], [1e-200, 0, 0, 0], [1, 0, 0, 0]])
    largest = np.array([10.0, 1e-24, 0, 1e-3, 1e-200, 2e38])
    with np.errstate(all="ignore"):
        unit, magnitude = quaternions(q, largest[:, None] * [1, 0.5, 0, 0])
    identity = [1.0, 0, 0, 0]
    np.testing.assert_allclose(unit, [[0.6, 0, 0, -0.8], [0, 0.6, 0.8, 0], *[identity] * 4], rtol=1e-15)
    np.testing.assert_allclose(magnitude, np.repeat([[2], [2], [1], [math.inf], [math.inf], [math.inf]], 4, axis=1))


def test_a_view_has_a_direction_however_near_or_far() -> None:
    """Any distance gives a direction, except a view from the anchor itself."""
    steps = np.array([[3.0, 0, -4]])
    with np.errstate(invalid="ignore"):
        near, far, *least = view(np.concatenate([steps * 1e-300, steps * 1e300, steps * 0, [[5e-324, 0, 0]]]))
    np.testing.assert_allclose(near, [0.6, 0, -0.8, 5e-300], rtol=1e-15)
    np.testing.assert_allclose(far, [0.6, 0, -0.8, 5e300], rtol=1e-15)
    assert [row.tolist() for row in least] == [[0, 0, 0, 0], [1, 0, 0, 5e-324]]


def test_values_of_slots_are_as_uncertain_as_features() -> None:
    """Features of 1e6 less 1e6: all but centres have a large m, though no number that networks see is large."""
    plan = replace(static_plans()["anchors"][1], counts=(4, 3))
    cancels = QuantisedMlp((linear([[1] * 4] * 2, [1] * 2, [1e6] * 2), linear([[1, -1]] * 4, [1] * 4, [0] * 4)))
    scene = replace(build(plan), decoder=cancels)
    made = activated(scene, expected_layers(scene)[-1], scene.fields.origin)
    assert not made["feature"].reference.any()
    centre = made.pop("gaussian.centre")
    assert all(array.magnitude is not None and np.median(array.magnitude) > 1e4 for array in made.values())
    assert centre.magnitude is not None
    assert (np.abs(centre.reference) * (1 - 1e-15) <= centre.magnitude).all()
    assert (centre.magnitude < 1e4).all()
