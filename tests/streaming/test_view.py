"""The part of each tile that a camera has in its picture."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from scarfmt.streaming.boxes import Boxes
from scarfmt.streaming.view import MARGIN, Camera, share_in_picture, tangent

CAMERA = Camera(np.zeros(3), np.array([0.0, 0, 2]), np.array([0.0, 3, 1]), math.radians(60), 400, 200)


def point(x: float, y: float, z: float) -> Boxes:
    at = np.array([[x, y, z]])
    return Boxes(at, at)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.1, 0.5, 1.0, 1.4, 1.55])
def test_the_tangent_is_that_of_the_library(angle: float) -> None:
    """The last bits may differ, because libraries do not agree on them."""
    assert tangent(angle) == pytest.approx(math.tan(angle), rel=1e-13)


def test_the_picture_has_four_sides_and_a_front() -> None:
    """A margin wider than it is; twice as wide as high here."""
    edge = MARGIN * math.tan(math.radians(30))
    for x, y, z, seen in (
        (0, 0, 1, 1), (0, 0, -1, 0), (0, 0.99 * edge, 1, 1), (0, 1.01 * edge, 1, 0), (0, -0.99 * edge, 1, 1),
        (0, -1.01 * edge, 1, 0), (1.99 * edge, 0, 1, 1), (2.01 * edge, 0, 1, 0), (-1.99 * edge, 0, 1, 1),
        (-2.01 * edge, 0, 1, 0),
    ):  # fmt: skip
        assert share_in_picture(point(x, y, z), CAMERA).tolist() == [seen], (x, y, z)


def test_a_box_is_in_it_by_its_part() -> None:
    """Half behind the eye is half; a box that is twice as high as the picture is half in it."""
    half = Boxes(np.array([[-1e-3, -1e-3, -1.0]]), np.array([[1e-3, 1e-3, 1.0]]))
    assert share_in_picture(half, CAMERA).tolist() == [0.5]
    high = math.tan(math.radians(30)) * 100
    for factor, part in ((1.3, 1.0), (2.0, 0.5)):
        box = Boxes(np.array([[-1, -factor * high, 100.0]]), np.array([[1, factor * high, 100.0]]))
        assert share_in_picture(box, CAMERA, 1.0).tolist() == [part]


def test_a_moving_camera_is_looked_from_where_it_will_be() -> None:
    moving = replace(CAMERA, velocity=np.array([0.0, 8.0, 0.0]))
    assert share_in_picture(point(0, 5, 2), moving)[0] == 1
    assert share_in_picture(point(0, 5, 2), CAMERA)[0] == 0
