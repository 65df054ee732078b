"""The up direction found from the Gaussians."""

from __future__ import annotations

import numpy as np
import pytest

from scarfmt.render.camera import AUTO
from scarfmt.render.upright import USUAL, Upright, resolved, upright
from scarfmt.render.viewpoints import Surroundings
from scarfmt.scene.gaussians import GaussianScene
from tests.render.scenes import random_scene

AXES = {"x": 0, "y": 1, "z": 2}


def field(up: str, count: int = 4000) -> GaussianScene:
    """A wide floor of flat Gaussians, with round ones standing on its middle, upright along `up`."""
    draw = np.random.default_rng(1)
    axis, sign = AXES[up[-1]], -1 if up[0] == "-" else 1
    positions = draw.uniform(-1, 1, (count, 3)) * 5
    floor = np.arange(count) % 4 > 0
    positions[:, axis] = sign * np.where(floor, 0, draw.uniform(0, 2, count))
    scales = np.full((count, 3), np.log(0.1), np.float32)
    scales[floor, axis] = np.log(0.005)
    rotations = np.tile(np.float32([1, 0, 0, 0]), (count, 1))
    return GaussianScene(
        positions, scales, rotations, np.full(count, 3, np.float32), np.zeros((count, 1, 3), np.float32)
    )


@pytest.mark.parametrize("up", ["z", "-z", "x", "-x", "-y"])
def test_a_floor_says_which_way_is_up(up: str) -> None:
    assert upright(field(up)) == Upright(up)


def test_a_scene_that_stands_on_its_head_is_doubted_or_turned() -> None:
    found = upright(field("y"))
    assert {found.up, found.other} == {"y", "-y"}


def test_what_does_not_say_is_as_most_scenes_are() -> None:
    assert upright(random_scene(1, 3000)) == Upright(USUAL)
    assert upright(random_scene(1, 1)) == Upright(USUAL)


def test_who_says_so_is_believed() -> None:
    assert resolved(field("z"), "x") == Upright("x", given=True)
    assert np.array_equal(Surroundings.of(field("z"), AUTO).axes, Surroundings.of(field("z"), "z").axes)
