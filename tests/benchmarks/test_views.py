"""Views that everything is judged from: of which kinds, looking where, and that they are nobody else's."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from benchmarks.views import HEIGHT, KINDS, WALKING, WIDTH, View, make_views
from scarfmt.cli.scenes import Subject
from scarfmt.render.camera import Camera, core, look_at
from scarfmt.render.viewpoints import KINDS as ENCODERS
from scarfmt.render.viewpoints import Surroundings, viewpoints
from scarfmt.scene.gaussians import GaussianScene

WHITE, BLACK = (np.full((HEIGHT, WIDTH, 3), level, np.float32) for level in (1, 0))


def scene(count: int = 500) -> GaussianScene:
    random = np.random.default_rng(4)
    zeros = np.zeros((count, 4), np.float32)
    positions = random.normal(size=(count, 3)) * (3, 1, 2)
    return GaussianScene(positions, zeros[:, :3], zeros, zeros[:, 0], np.zeros((count, 1, 3), np.float32))


def views(picture: np.ndarray = WHITE, capture: tuple[Camera, ...] = (), up: str = "-y") -> list[View]:
    return make_views(Subject(lambda _camera: picture, scene()), up, capture)


def test_forty_views_of_three_kinds_and_those_of_the_capture() -> None:
    photo = look_at(np.ones(3), np.zeros(3), np.array([0, -1.0, 0]), 640, 480, name="photo")
    found = views(capture=(photo,))
    assert Counter(view.kind for view in found) == {"orbit": 12, "near": 8, "inside": 8 + WALKING, "capture": 1}
    assert set(KINDS) == {view.kind for view in found}
    assert {(view.camera.width, view.camera.height) for view in found} == {(WIDTH, HEIGHT)}
    assert len({view.camera.world_to_camera.tobytes() for view in found}) == len(found)
    assert len({view.camera.name for view in found}) == len(found)


@pytest.mark.parametrize("up", ["-y", "z"])
def test_eyes_are_where_their_kind_says(up: str) -> None:
    """Near ones at most a radius away, orbits farther, those inside within the core; pictures stand upright."""
    vertical = {"-y": np.array([0, -1.0, 0]), "z": np.array([0, 0, 1.0])}[up]
    middle, half = core(scene(), vertical)
    radius = np.linalg.norm(half)
    for kind, camera in views(up=up):
        away = np.linalg.norm(camera.centre - middle) / radius
        assert {"orbit": 1.7 < away < 4.1, "near": 0.5 < away < 1.1, "inside": away < 1.01}[kind], camera.name
        assert -camera.world_to_camera[1, :3] @ vertical > 0.2
        if "walking" in camera.name:
            assert (camera.centre - middle) @ vertical == pytest.approx(-(half @ np.abs(vertical)) / 3)


def test_what_shows_nothing_is_left_out() -> None:
    """A dark picture is no view of the scene; photos are, whatever they show."""
    photo = look_at(np.ones(3), np.zeros(3), np.array([0, -1.0, 0]), WIDTH, HEIGHT)
    assert [view.kind for view in views(BLACK, (photo,))] == ["capture"]


def test_they_are_no_views_of_the_encoder() -> None:
    around = Surroundings.of(scene(), "-y")
    theirs = {c.world_to_camera.tobytes() for kind in ENCODERS for c in viewpoints(around, kind, 100, 2023)}
    assert not theirs & {view.camera.world_to_camera.tobytes() for view in views()}
