"""Cameras look where they should, and unreadable descriptions of them are refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scarfmt.errors import InvalidInput
from scarfmt.render.camera import Arc, Camera, core, find_subject, look_at, orbit_cameras, warn_if_much_lies_apart
from scarfmt.render.rasterise import render
from scarfmt.scene.gaussians import GaussianScene
from tests.samples.codec_samples import refuses

from .scenes import random_scene


def _project(camera: Camera, point: np.ndarray) -> tuple[float, float, float]:
    x, y, z = camera.world_to_camera[:3, :3] @ point + camera.world_to_camera[:3, 3]
    return camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy, z


@pytest.mark.parametrize("up", ["x", "-x", "y", "-y", "z", "-z"])
def test_orbit_circles_one_point_right_way_up(up: str) -> None:
    """All eyes are level round one target, which is mid-picture, and `up` points up in every picture."""
    axis = np.zeros(3)
    axis["xyz".index(up[-1])] = -1 if up[0] == "-" else 1
    cameras = orbit_cameras(random_scene(0), 8, up=up, elevation_deg=30)
    eyes = np.array([camera.centre for camera in cameras])
    assert np.ptp(eyes @ axis) < 1e-9
    radius = np.linalg.norm(eyes[0] - eyes[4]) / 2
    target = eyes.mean(axis=0) - axis * radius * np.tan(np.radians(30))
    for camera in cameras:
        assert np.linalg.det(camera.world_to_camera[:3, :3]) == pytest.approx(1)
        column, row, depth = _project(camera, target)
        assert (column, row) == (pytest.approx(320), pytest.approx(240))
        assert depth > 0
        above = _project(camera, target + 0.1 * axis)
        assert above[0] == pytest.approx(320)
        assert above[1] < 240


def test_orbit_holds_the_core_in_the_picture() -> None:
    scene = random_scene(1, 5000)
    low, high = np.percentile(scene.positions, [10, 90], axis=0)
    inside = scene.positions[((scene.positions > low) & (scene.positions < high)).all(axis=1)]
    widths = []
    for camera in orbit_cameras(scene, 4):
        columns, rows, depths = np.array([_project(camera, point) for point in inside]).T
        shown = (columns > 0) & (columns < 640) & (rows > 0) & (rows < 480) & (depths > 0)
        assert shown.mean() > 0.95
        widths.append(np.ptp(columns))
    assert max(widths) > 320


def test_arc_covers_its_span_with_both_ends() -> None:
    assert Arc.parse("-y:125:70").azimuths(3).tolist() == [90, 125, 160]
    assert Arc.parse("z").azimuths(4).tolist() == [0, 90, 180, 270]
    assert Arc.parse("z:40:70").azimuths(1).tolist() == [40]


@pytest.mark.parametrize(
    ("up", "expected"), [("-y", [0, 0, -1]), ("y", [0, 0, 1]), ("z", [0, 1, 0]), ("-z", [0, -1, 0])]
)
def test_azimuth_90_is_where_the_documentation_says(up: str, expected: list[int]) -> None:
    camera = orbit_cameras(random_scene(2), 1, up=f"{up}:90:0", elevation_deg=0)[0]
    looking = camera.world_to_camera[2, :3]
    np.testing.assert_allclose(-looking, expected, atol=1e-12)


@pytest.mark.parametrize("text", ["", "w", "--y", "y:1", "y:1:2:3", "y:a:2", "y:1:400", "y:1:-1", "y:nan:2", "y:inf:2"])
def test_unreadable_frames_are_refused(text: str) -> None:
    refuses("input-frame", lambda: Arc.parse(text))


@given(st.text(alphabet="xyz-+:0123456789.e n", max_size=14))
def test_any_frame_text_is_read_or_refused(text: str) -> None:
    try:
        arc = Arc.parse(text)
    except InvalidInput:
        return
    assert np.isfinite(arc.azimuths(5)).all()


def test_looking_straight_down_still_gives_a_rotation() -> None:
    camera = look_at(np.array([0.0, 0, 5]), np.zeros(3), np.array([0.0, 0, 1]), 10, 10)
    rotation = camera.world_to_camera[:3, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(camera.centre, [0, 0, 5])


def test_orbit_of_nothing_is_refused_and_of_a_point_is_not() -> None:
    scene = random_scene(3, 5)
    refuses("input-empty", lambda: orbit_cameras(scene.take(np.arange(0))))
    assert np.isfinite(orbit_cameras(scene.take(np.array([2])))[0].world_to_camera).all()


def test_orbit_of_a_tiny_scene_sees_what_that_of_a_large_one_sees() -> None:
    """The near plane scales with scenes smaller than a unit, or a toy in metres would lose its nose."""
    scene = random_scene(5)
    tiny = replace(scene, positions=scene.positions * 1e-3, log_scales=scene.log_scales + np.float32(np.log(1e-3)))
    small = replace(scene, positions=scene.positions * 1e-1, log_scales=scene.log_scales + np.float32(np.log(1e-1)))
    pictures = [render(each, orbit_cameras(each, 1, 64, 48)[0]) for each in (small, tiny)]
    assert pictures[0].std() > 0.05
    np.testing.assert_allclose(pictures[0], pictures[1], atol=0.3)
    assert np.abs(pictures[0] - pictures[1]).mean() < 0.005


def test_scaled_camera_sees_the_same_directions() -> None:
    camera = orbit_cameras(random_scene(4), 1)[0]
    half = camera.scale(0.5)
    point = np.array([0.3, -0.2, 2.0])
    assert (half.width, half.height) == (320, 240)
    np.testing.assert_allclose(np.array(_project(half, point)[:2]) * 2, _project(camera, point)[:2])


def _before_sky(far: float, share: float) -> GaussianScene:
    """A ball of deviation 1 at (5, 0, 0), a share of it moved to a sphere so far away."""
    rng, scene = np.random.default_rng(3), random_scene(3, 2000)
    positions = rng.normal(size=(2000, 3))
    sky = int(2000 * share)
    positions[:sky] *= far / np.linalg.norm(positions[:sky], axis=1, keepdims=True)
    positions[sky] = np.nan
    return replace(scene, positions=positions + np.array([5.0, 0, 0]))


@pytest.mark.parametrize(("far", "share"), [(30, 0.3), (1000, 0.4), (100, 0.25)])
def test_the_core_is_the_subject_before_a_wide_sky(far: float, share: float) -> None:
    middle, half = core(_before_sky(far, share), np.array([0.0, 1.0, 0.0]))
    np.testing.assert_allclose(middle, [5, 0, 0], atol=0.2)
    np.testing.assert_allclose(half, 1.28, rtol=0.15)


def test_all_that_is_finite_is_the_subject_of_a_scene_without_a_sky() -> None:
    positions = _before_sky(4, 0.3).positions
    np.testing.assert_array_equal(find_subject(positions), np.isfinite(positions).all(axis=1))
    assert find_subject(np.zeros((5, 3))).all()


@pytest.mark.parametrize(("places", "warned"), [([0, 300, 2400], True), ([0, 3, 24], False)])
def test_scenes_of_which_most_lies_far_from_the_rest_are_warned_of(
    recwarn: pytest.WarningsRecorder, places: list[float], warned: bool
) -> None:
    """Of three clusters with 45, 30 and 25 % of the Gaussians the first is the subject."""
    positions = np.random.default_rng(3).normal(size=(1000, 3))
    positions[:, 0] += np.repeat(places, [450, 300, 250])
    warn_if_much_lies_apart(positions)
    assert any("far away" in str(each.message) for each in recwarn.list) == warned
