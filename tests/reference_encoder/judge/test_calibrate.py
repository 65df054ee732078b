"""The quality that was asked for: corrections that converge, and views that do not flatter."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from reference_encoder.judge.calibrate import Judge, calibrated, judged_cameras, next_aim
from reference_encoder.measure.survey import survey
from reference_encoder.options import EncodeOptions
from reference_encoder.tuning import TOLERANCE_DB
from scarfmt.render.camera import Camera, orbit_cameras
from scarfmt.scene.gaussians import GaussianScene
from tests.render.scenes import random_scene


@given(asked=st.floats(25, 60), offset=st.floats(-4, 10), slope=st.floats(0.7, 1.8), bend=st.floats(-0.01, 0.01))
def test_corrections_reach_what_was_asked(asked: float, offset: float, slope: float, bend: float) -> None:
    """Whatever the offset and slope of the prediction, a few corrections end within tolerance, if bounds allow it."""

    def gives(aim: float) -> float:
        return asked + offset + slope * (aim - asked) + bend * (aim - asked) ** 2

    # Corrections go 15 dB down and 6 dB up, no further: what lies beyond is not reached.
    assume(gives(asked - 15) <= asked <= gives(asked + 6))
    found = calibrated(asked, 6, lambda aim: aim, gives)
    assert abs(gives(found) - asked) <= TOLERANCE_DB


def test_no_more_attempts_than_corrections() -> None:
    """Each correction is one more attempt, and the one after the last is not judged."""
    attempts: list[float] = []
    judged: list[float] = []

    def attempt(aim: float) -> float:
        attempts.append(aim)
        return aim

    def judge(aim: float) -> float:
        judged.append(aim)
        return aim + 5

    calibrated(40.0, 1, attempt, judge)
    assert attempts == [40.0, 35.0]
    assert judged == [40.0]


def test_close_enough_is_left_alone() -> None:
    """Within tolerance, or with pictures without any error, nothing is tried again."""
    assert next_aim(41.0, [(41.0, 41.0 + TOLERANCE_DB / 2)]) is None
    assert next_aim(41.0, [(41.0, math.inf)]) is None


def test_an_error_that_stays_buys_only_so_many_bits() -> None:
    """When pictures do not get better, the aim stays within a few dB of what was asked."""
    tried = [(70.0, 60.0)]
    for _ in range(5):
        better = next_aim(70.0, tried)
        assert better is not None
        assert better <= 76.0
        tried.append((better, 60.0))


@pytest.fixture(scope="module")
def scene() -> GaussianScene:
    """Some Gaussians."""
    return random_scene(0, 300)


def _poses(cameras: list[Camera]) -> set[bytes]:
    return {camera.world_to_camera.tobytes() for camera in cameras}


@pytest.mark.parametrize("effort", [1, 2, 3])
@pytest.mark.parametrize("frame", ["-y", "-y:90:40"])
def test_results_are_judged_from_elsewhere(scene: GaussianScene, effort: int, frame: str) -> None:
    """No judged view is one that sensitivities are measured from."""
    options = EncodeOptions(effort=effort, frame=frame)
    judged = judged_cameras(scene, options)
    assert judged
    assert not _poses(judged) & _poses(survey(scene, options).cameras)


def test_given_cameras_judge(scene: GaussianScene) -> None:
    """Of many cameras, some, and none of the photos for tests; of a few, all."""
    cameras = orbit_cameras(scene, 60)
    options = EncodeOptions(cameras=[*cameras, replace(cameras[0], split="test")])
    assert {camera.split for camera in judged_cameras(scene, options)} == {""}
    few = EncodeOptions(cameras=cameras[:3])
    assert judged_cameras(scene, few) == cameras[:3]


def test_judge_compares_with_the_source(scene: GaussianScene) -> None:
    """The source itself is without error; a changed one is as far off as its pictures are."""
    judge = Judge.of(scene, EncodeOptions(effort=1))
    assert judge.psnr_db(scene) == math.inf
    darker = replace(scene, sh=(scene.sh * np.float32(0.9)))
    assert 10 < judge.psnr_db(darker) < 60
    assert len(judge.fewer(2).cameras) == 2
