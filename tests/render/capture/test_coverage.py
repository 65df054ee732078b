"""Cameras of another frame or scale than the scene's are noticed."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from scarfmt.errors import InputWarning
from scarfmt.render.camera import look_at, orbit_cameras, part_in_view, warn_if_cameras_miss_scene

from ..scenes import random_scene


def test_cameras_of_the_scene_are_no_strangers() -> None:
    scene = random_scene(1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_if_cameras_miss_scene(scene.positions, orbit_cameras(scene, 3))
    assert part_in_view(scene.positions, orbit_cameras(scene, 3)) > 0.5


def test_cameras_that_look_elsewhere_are() -> None:
    scene = random_scene(1)
    away = look_at(np.array([0.0, 0, 100]), np.array([0.0, 0, 200]), np.array([0.0, 1, 0]), 640, 480)
    with pytest.warns(InputWarning, match="half of the 1 have at most 0 % of it in"):
        warn_if_cameras_miss_scene(scene.positions, [away])
