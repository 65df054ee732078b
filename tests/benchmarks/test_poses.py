"""The benchmark of poses: points that both photos show lie on their lines, and a wrong pose is pixels off."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.poses import Fit, sampson, tables
from scarfmt.arrays import F64
from scarfmt.render.camera import Camera


def camera(turn: float, shift: float = 0.0) -> Camera:
    """Three units from the origin, looking at it from an angle, radians, and `shift` too far to the right."""
    pose = np.eye(4)
    pose[0, [0, 2]] = np.cos(turn), np.sin(turn)
    pose[2, [0, 2]] = -np.sin(turn), np.cos(turn)
    pose[:3, 3] = shift, 0, 3
    return Camera(400, 300, 310.0, 305.0, 203.0, 148.0, pose)


def shown(camera: Camera, points: F64) -> F64:
    """(n, 2) places of points in a photo."""
    x, y, z = (points @ camera.world_to_camera[:3, :3].T + camera.world_to_camera[:3, 3]).T
    return np.column_stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy])


@pytest.fixture
def points() -> F64:
    """In a unit cube."""
    return np.random.default_rng(0).uniform(-0.5, 0.5, (200, 3))


def test_what_both_photos_show_lies_on_its_line(points: F64) -> None:
    one, other = camera(0.1), camera(0.6)
    assert sampson(one, other, shown(one, points), shown(other, points)).max() < 1e-9


def test_a_place_beside_its_line_is_so_far_off(points: F64) -> None:
    """Two places that share an error take half of it each, so the whole is its length over the root of two."""
    one, other = camera(0.0), camera(0.5)
    beside = shown(other, points) + np.array([0.0, 2.0])
    found = sampson(one, other, shown(one, points), beside)
    assert np.median(found) == pytest.approx(2 / np.sqrt(2), rel=0.05)


def test_a_pose_that_drifted_is_noticed(points: F64) -> None:
    """Photos of a loop's two ends: a lift that no two neighbours would notice."""
    one, other = camera(0.0), camera(0.5)
    places = shown(one, points), shown(other, points)
    pose = other.world_to_camera.copy()
    pose[1, 3] += 0.05
    assert np.median(sampson(one, replace(other, world_to_camera=pose), *places)) > 2


def test_medians_of_pairs() -> None:
    assert Fit.of([]) is None
    assert Fit.of([0.1] * 10 + [0.3] * 9 + [50.0]) == Fit(20, pytest.approx(0.2), pytest.approx(0.3))
    text = tables({"a": {"photos": 9, "near": {"pairs": 3, "median": 0.123, "most": 0.4}, "far": None}})
    assert "| a | 9 | 3 | 0.12 | 0.40 | – | – | – |" in text
