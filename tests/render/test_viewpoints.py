"""Views from everywhere: even, reproducible, and where their kind says; and the up direction of the Gaussians."""

from __future__ import annotations

import numpy as np
import pytest

from scarfmt.render.camera import AUTO, look_at
from scarfmt.render.rasterise import render
from scarfmt.render.viewpoints import (
    KINDS,
    USUAL,
    Surroundings,
    Upright,
    beside,
    choose_occupied,
    even_numbers,
    resolve_frame,
    upright,
    viewpoints,
)
from scarfmt.scene.gaussians import GaussianScene
from tests.render.scenes import random_scene


@pytest.fixture
def around() -> Surroundings:
    return Surroundings.of(random_scene(3, 2000), "z")


@pytest.mark.parametrize("kind", KINDS)
def test_a_seed_gives_the_same_views_and_another_seed_others(around: Surroundings, kind: str) -> None:
    def eyes(seed: int) -> np.ndarray:
        return np.stack([camera.centre for camera in viewpoints(around, kind, 12, seed)])

    assert np.array_equal(eyes(1), eyes(1))
    assert not np.isclose(eyes(1)[:, None], eyes(2)[None]).all(axis=2).any()


def test_eyes_are_as_far_as_their_kind_says(around: Surroundings) -> None:
    def distances(kind: str) -> np.ndarray:
        eyes = np.stack([camera.centre for camera in viewpoints(around, kind, 64, 5)])
        return np.asarray(np.linalg.norm(eyes - around.middle, axis=1) / around.radius)

    assert 1.2 <= distances("orbit").min() < 1.4
    assert 3.5 < distances("orbit").max() <= 4
    assert distances("inside").max() <= 1


def test_eyes_outside_stay_in_the_arc_and_those_inside_look_along_it() -> None:
    around = Surroundings.of(random_scene(3, 2000), "z:90:40")
    for camera in viewpoints(around, "orbit", 32, 5):
        x, y, _ = camera.centre - around.middle
        assert abs(np.degrees(np.arctan2(y, x)) - 90) <= 20 + 1e-6
    for camera in viewpoints(around, "inside", 32, 5):
        assert camera.world_to_camera[2, 1] < -np.cos(np.radians(45))


@pytest.mark.parametrize("dimensions", [1, 2, 7])
def test_numbers_fill_their_range_more_evenly_than_chance(dimensions: int) -> None:
    numbers = even_numbers(256, dimensions, seed=1)
    assert numbers.shape == (256, dimensions)
    assert (numbers >= 0).all()
    assert (numbers < 1).all()
    for column in numbers.T:
        assert np.bincount((column * 16).astype(int), minlength=16).min() >= 10


def test_sampled_pixels_are_those_of_the_whole_picture() -> None:
    """With an odd stride the centre of a small pixel is that of a large one, so that the values agree."""
    scene = random_scene(2, 300)
    whole = look_at(np.array([0.0, 0, -4]), np.zeros(3), np.array([0.0, -1, 0]), 90, 60)
    np.testing.assert_allclose(render(scene, whole.sample(3)), render(scene, whole)[1::3, 1::3], atol=1e-5)


def test_near_views_reach_every_region() -> None:
    """For a crowd and a few Gaussians far from it, both are among the pieces to look at, the crowd more often."""
    draw = np.random.default_rng(0)
    crowd, lonely = draw.normal(0, 0.01, (9000, 3)), np.array([[5.0, 0, 0], [0, 5, 0], [0, 0, 5]])
    places = choose_occupied(np.concatenate([crowd, lonely]), 1.0)
    assert all((np.abs(places - place).max(axis=1) < 1e-9).any() for place in lonely)
    assert 50 < (np.abs(places) < 0.1).all(axis=1).sum() < 1000


def test_views_beside_cameras_are_close_to_them(around: Surroundings) -> None:
    cameras = viewpoints(around, "orbit", 20, 1)
    found = beside(cameras, 0.1, 10, 3)
    moved = np.stack([new.centre - old.centre for new, old in zip(found, cameras, strict=True)])
    assert 0 < np.abs(moved).max() <= 0.1
    turned = [
        np.degrees(np.arccos(new.world_to_camera[2, :3] @ old.world_to_camera[2, :3]))
        for new, old in zip(found, cameras, strict=True)
    ]
    assert 1 < np.median(turned) < max(turned) < 18


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
    assert resolve_frame(field("z"), "x") == Upright("x", given=True)
    assert np.array_equal(Surroundings.of(field("z"), AUTO).axes, Surroundings.of(field("z"), "z").axes)
