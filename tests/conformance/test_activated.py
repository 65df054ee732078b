"""The binary64 reference of activated values, against numbers known otherwise."""

from __future__ import annotations

import math

import numpy as np

from conformance.activated import Activated, logits, network, rotations
from scarfmt.codecs.mlp import Linear, Network


def linear(weights: list[list[int]], scales: list[float], biases: list[float]) -> Linear:
    return Linear(np.array(weights, np.int16), np.array(scales, np.float32), np.array(biases, np.float32))


def test_rotations_turn_the_third_axis_to_the_normal() -> None:
    """Of the octahedral map: its middle is +z, a corner -z's neighbour, an edge's middle a horizontal axis."""
    q = rotations(np.array([[0.0, 0, 0], [1, 1, 0], [0.5, 0.0, 0.0], [0, 0, math.pi]]))
    w, x, y, z = q.T
    third = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=1)
    half = math.sqrt(0.5)
    expected = np.array([[0, 0, 1], [1, 0, 0], [1, 1, 2] / np.sqrt(6), [0, 0, 1]])
    np.testing.assert_allclose(third, expected, atol=1e-15)
    np.testing.assert_allclose(q[:2], [[1, 0, 0, 0], [half, 0, half, 0]], atol=1e-15)
    np.testing.assert_allclose(np.abs(q[3]), [0, 0, 0, 1], atol=1e-15)


def test_a_rotation_has_no_negative_cosine() -> None:
    """Twists beyond half a turn give the other one of the two equal quaternions."""
    q = rotations(np.array([[0.0, 0, 1.0], [0, 0, 1.0 + 2 * math.pi]]))
    np.testing.assert_allclose(q[0], q[1], atol=1e-15)
    assert q[0, 0] > 0


def test_logits_are_those_of_the_opacity_and_end_at_the_largest() -> None:
    """ln 0.5 is logit 0; all above -2^-13 are one; far below, the logit is the logarithm."""
    largest = -math.log(-math.expm1(-(2.0**-13))) - 2.0**-13
    found = logits(np.array([math.log(0.5), 0.0, 5.0, -(2.0**-13), -800.0]))
    np.testing.assert_allclose(found, [0, largest, largest, largest, -800], atol=1e-15)


def test_a_network_and_its_magnitude() -> None:
    """Two layers, by hand; m replaces every weight, bias and input by its magnitude, so that no ReLU cuts."""
    first = linear([[2, -1], [-3, 0]], [0.5, 1], [1, -2])
    second = linear([[1, -4]], [0.25], [-1])
    made = network(Network((first, second)), np.array([[1.0, 8.0], [-1.0, 0.0]]))
    # Hidden: 1 - 4 + 1 and -3 - 2, then -1 + 1 and 3 - 2.
    assert made.reference.tolist() == [[-1.0], [0.25 * (0 - 4 * 1) - 1]]
    assert made.magnitude is not None
    # Hidden magnitudes: 1 + 4 + 1 and 3 + 2, then 1 + 0 + 1 and 3 + 2.
    assert made.magnitude.tolist() == [[0.25 * (6 + 4 * 5) + 1], [0.25 * (2 + 4 * 5) + 1]]


def test_a_network_of_huge_numbers_overflows_to_infinity() -> None:
    """It is no error (SPEC §15)."""
    net = Network((linear([[1, 1]], [3e38], [0]),))
    assert network(net, np.array([[1e300, 1e300]])).reference.tolist() == [[math.inf]]


def test_references_come_before_their_magnitudes() -> None:
    """Little-endian, C order."""
    reference = np.array([[1.0, -2.0]])
    assert Activated(reference).to_bytes() == np.array([1.0, -2.0], "<f8").tobytes()
    assert Activated(reference, 3 * reference).to_bytes() == np.array([1.0, -2.0, 3.0, -6.0], "<f8").tobytes()
