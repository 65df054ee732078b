"""A few places that stand for many views."""

from __future__ import annotations

import numpy as np

from reference_encoder.streaming.eyes import eyes
from scarfmt.render.camera import Camera, look_at

UP = np.array([0.0, 1.0, 0.0])


def crowd(centre: tuple[float, float, float], count: int, seed: int = 0) -> list[Camera]:
    """Views from around a place, in all directions."""
    draw = np.random.default_rng(seed)
    places = np.array(centre) + 0.1 * draw.normal(size=(count, 3))
    return [look_at(eye, eye + draw.normal(size=3), UP, 64, 48, 60.0) for eye in places]


def test_every_crowd_has_an_eye_the_largest_first() -> None:
    """Each eye says which part of the views it stands for, and it looks several ways."""
    cameras = [*crowd((0, 0, 0), 5), *crowd((10, 0, 0), 20), *crowd((0, 0, 10), 10)]
    found = eyes(cameras, 3)
    assert [round(float(eye.centre.max())) for eye in found] == [10, 10, 0]
    assert [eye.share for eye in found] == [20 / 35, 10 / 35, 5 / 35]
    assert all(len(eye.cameras) == 3 for eye in found)
    assert all(np.array_equal(eye.cameras[0].centre, eye.centre) for eye in found)


def test_an_eye_is_one_of_the_views() -> None:
    """A mean of places may lie inside a wall."""
    cameras = crowd((0, 0, 0), 40)
    centres = {tuple(camera.centre) for camera in cameras}
    assert {tuple(eye.centre) for eye in eyes(cameras, 7)} <= centres


def test_there_are_no_more_eyes_than_places() -> None:
    """One place gives one eye, whatever number is requested."""
    camera = crowd((1, 2, 3), 1)[0]
    assert len(eyes([camera] * 6, 4)) == 1
    assert len(eyes(crowd((0, 0, 0), 3), 8)) == 3
