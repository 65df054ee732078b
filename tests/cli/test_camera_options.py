"""A camera is what the options say, else what the file says, else outside of all there is."""

from __future__ import annotations

import math

import numpy as np
import pytest

from scarfmt.blocks.streaming import View
from scarfmt.cli.camera_options import camera_of

NOTHING = dict.fromkeys(("camera", "target", "up", "fov", "size"))
GIVEN = {"camera": (1, 2, 3), "target": (4, 2, 3), "up": (0, 0, 1), "fov": 90.0, "size": (8, 6)}
BOXES = np.array([[0.0, 0, 0], [3, 4, 0]]), np.array([[1.0, 1, 1], [4, 4, 2]])
VIEW = View(np.array([5.0, 0, 0]), np.array([5.0, 0, 2]), np.array([0.0, 1, 0]), 0.75)


@pytest.mark.parametrize(
    ("values", "boxes", "view", "numbers"),
    [
        (GIVEN, BOXES, VIEW, (1, 2, 3, 3, 0, 0, 0, 0, 1, math.pi / 2, 8, 6)),
        (NOTHING, BOXES, VIEW, (5, 0, 0, 0, 0, 2, 0, 1, 0, 0.75, 640, 480)),
        (NOTHING | {"target": (4, 0, 0)}, BOXES, VIEW, (5, 0, 0, -1, 0, 0, 0, 1, 0, 0.75, 640, 480)),
        (NOTHING, BOXES, None, (2, 2, 1 - 7.2, 0, 0, 7.2, 0, -1, 0, math.pi / 3, 640, 480)),
        (NOTHING, (np.zeros((0, 3)), np.zeros((0, 3))), None, (0, 0, -1, 0, 0, 1, 0, -1, 0, math.pi / 3, 640, 480)),
    ],
)
def test_options_win_over_the_file_and_that_over_a_view_from_outside(
    values: dict[str, object], boxes: tuple[np.ndarray, np.ndarray], view: View | None, numbers: tuple[float, ...]
) -> None:
    found = camera_of(values, boxes, view)
    lens = found.fov_y, found.width, found.height
    assert [*found.position, *found.forward, *found.up, *lens] == pytest.approx(numbers)
