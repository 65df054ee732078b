"""Views from everywhere, beside given cameras, or from these alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from reference_encoder.importance.view_sampling import BESIDE, GIVEN, count_views, sample_views
from reference_encoder.options import EFFORTS, EncodeOptions
from reference_encoder.tuning import MOST_LOCAL_VIEWS
from scarfmt.render.camera import Camera, orbit_cameras
from scarfmt.render.viewpoints import KINDS
from scarfmt.scene.gaussians import GaussianScene
from tests.render.scenes import random_scene


@pytest.fixture
def scene() -> GaussianScene:
    return random_scene(3, 2000)


@pytest.fixture
def cameras(scene: GaussianScene) -> list[Camera]:
    every = orbit_cameras(scene, 31, width=640, height=480)
    return [replace(camera, split="test" if number % 8 == 0 else "train") for number, camera in enumerate(every)]


def test_a_survey_looks_from_every_kind_of_place(scene: GaussianScene) -> None:
    found = sample_views(scene, EncodeOptions(effort=1, frame="z"))
    assert set(found.views) == set(KINDS)
    assert sum(found.shares.values()) == pytest.approx(1)
    assert len(found.cameras) == EFFORTS[1].survey_views
    assert {(camera.width, camera.height) for camera in found.cameras} == {(160, 120)}


def test_views_grow_with_what_a_scene_holds_up_to_a_bound() -> None:
    counts = [sum(count_views(2, gaussians).values()) for gaussians in (1, 100_000, 2_000_000, 10**8)]
    assert counts[0] == counts[1] == EFFORTS[2].survey_views
    assert counts[1] < counts[2] < counts[3] <= MOST_LOCAL_VIEWS + EFFORTS[2].survey_views


def test_given_cameras_are_all_used_with_their_neighbourhood_and_the_rest(
    scene: GaussianScene, cameras: list[Camera]
) -> None:
    found = sample_views(scene, EncodeOptions(cameras=cameras, frame="z"))
    training = np.stack([camera.centre for camera in cameras if camera.split != "test"])
    assert set(found.views) == {GIVEN, BESIDE, *KINDS}
    assert np.allclose(np.stack([camera.centre for camera in found.views[GIVEN]]), training)
    moved = np.linalg.norm(np.stack([camera.centre for camera in found.views[BESIDE]]) - training, axis=1)
    assert 0 < moved.min() <= moved.max() < found.radius
    assert sum(found.shares.values()) == pytest.approx(1)


def test_a_scene_of_which_most_lies_far_from_where_it_is_looked_at_is_warned_of(
    scene: GaussianScene, cameras: list[Camera], recwarn: pytest.WarningsRecorder
) -> None:
    """Cameras come near it."""
    apart = np.array([0, 1e3, 8e3])[np.searchsorted([9, 15], np.arange(len(scene)) % 20, side="right")]
    scattered = replace(scene, positions=scene.positions + apart[:, None])
    sample_views(scattered, EncodeOptions(cameras=cameras, frame="z"))
    sample_views(scene, EncodeOptions(frame="z"))
    assert not recwarn.list
    sample_views(scattered, EncodeOptions(frame="z"))
    assert "others lie far away" in str(recwarn.pop().message)


def test_only_cameras_is_a_fence(scene: GaussianScene, cameras: list[Camera]) -> None:
    found = sample_views(scene, EncodeOptions(cameras=cameras, only_cameras=True, frame="z"))
    assert set(found.views) == {GIVEN}
