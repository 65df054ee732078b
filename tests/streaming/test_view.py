"""Which tiles a camera has in its picture."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from scarfmt.streaming.boxes import Boxes
from scarfmt.streaming.view import MARGIN, Camera, in_picture, tangent

CAMERA = Camera(np.zeros(3), np.array([0.0, 0, 2]), np.array([0.0, 3, 1]), math.radians(60), 400, 200)


def point(x: float, y: float, z: float, reach: float = 0.0) -> Boxes:
    at = np.array([[x, y, z]])
    return Boxes(at, at, np.array([reach]))


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.1, 0.5, 1.0, 1.4, 1.55])
def test_the_tangent_is_that_of_the_library(angle: float) -> None:
    """But for the last bits, which libraries do not agree about."""
    assert tangent(angle) == pytest.approx(math.tan(angle), rel=1e-13)


def test_the_picture_has_four_sides_and_a_front() -> None:
    """A margin wider than it is; twice as wide as high here."""
    edge = MARGIN * math.tan(math.radians(30))
    for x, y, z, seen in (
        (0, 0, 1, True), (0, 0, -1, False), (0, 0.99 * edge, 1, True), (0, 1.01 * edge, 1, False),
        (0, -0.99 * edge, 1, True), (0, -1.01 * edge, 1, False), (1.99 * edge, 0, 1, True), (2.01 * edge, 0, 1, False),
        (-1.99 * edge, 0, 1, True), (-2.01 * edge, 0, 1, False),
    ):  # fmt: skip
        assert in_picture(point(x, y, z), CAMERA).tolist() == [seen], (x, y, z)


def test_what_sticks_out_is_seen_too() -> None:
    """A box is where its splats are."""
    assert not in_picture(point(0, 5, 1), CAMERA)[0]
    assert in_picture(point(0, 5, 1, 5), CAMERA)[0]


def test_a_moving_camera_is_looked_from_where_it_will_be() -> None:
    moving = replace(CAMERA, velocity=np.array([0.0, 8.0, 0.0]))
    assert in_picture(point(0, 5, 2), moving)[0]
    assert not in_picture(point(0, 5, 2), CAMERA)[0]
