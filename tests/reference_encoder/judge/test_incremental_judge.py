"""Later tries judged by some of the views: as all views would, at a part of the pictures."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from reference_encoder.judge.quality import IncrementalJudge, Judge, View, compared_views
from reference_encoder.tuning import FEWEST_COMPARED, MOST_MOVED_DB, VIEWS_A_COMPARED
from scarfmt.arrays import F32
from scarfmt.render.camera import Camera

VIEWS = 40


@dataclass
class _Drawn:
    """Pictures of one pixel, off by what a scene says, times what a view says; counts those that are drawn."""

    counts: list[int] = field(default_factory=list)

    def view(self, error: float) -> View:
        """Draws a scene that is off by `error`."""
        self.counts.append(0)

        def draw(camera: Camera) -> F32:
            self.counts[-1] += 1
            return np.full((1, 1, 3), error * camera.fx, np.float32)

        return draw


def _tries(by_mean: bool = True) -> tuple[IncrementalJudge[float], _Drawn]:
    drawn, draw = _Drawn(), np.random.default_rng(0)
    cameras = [Camera(1, 1, float(fx), 1, 0, 0, np.eye(4)) for fx in draw.uniform(0.01, 1, VIEWS)]
    nothing = np.zeros((1, 1, 3), np.float32)
    seen = {kind: [(camera, nothing) for camera in cameras] for kind in ("near", "inside")}
    return IncrementalJudge(Judge(drawn.view, seen, {"near": 0.5, "inside": 0.5}), by_mean), drawn


def test_a_try_nearby_is_judged_by_what_some_views_say_of_the_change() -> None:
    """Views differ by 40 dB here, the change is the same in all of them: it is found to the digit."""
    tries, drawn = _tries()
    before = tries.psnr_db(0.010)
    assert tries.psnr_db(0.0096) == pytest.approx(before + 20 * np.log10(0.010 / 0.0096), abs=1e-4)
    assert drawn.counts == [2 * VIEWS, 2 * VIEWS // VIEWS_A_COMPARED]


def test_a_try_far_away_is_judged_by_all_views_and_the_next_by_its_pictures() -> None:
    """After large changes views do not change alike."""
    tries, drawn = _tries()
    before = tries.psnr_db(0.010)
    far = 0.010 / 10 ** ((MOST_MOVED_DB + 1) / 20)
    assert tries.psnr_db(far) == pytest.approx(before + MOST_MOVED_DB + 1, abs=1e-4)
    tries.psnr_db(far)
    assert [count == 2 * VIEWS for count in drawn.counts] == [True, False, True, False]


def test_a_floor_is_judged_by_all_views() -> None:
    """The 5th percentile of some views is not that of all."""
    tries, drawn = _tries(by_mean=False)
    tries.psnr_db(0.010)
    tries.psnr_db(0.0096)
    assert drawn.counts == [2 * VIEWS, 2 * VIEWS]


def test_few_views_are_all_compared() -> None:
    """At least so many of each kind, if there are as many."""
    for count in range(1, 200):
        assert len(range(count)[compared_views(count)]) >= min(count, FEWEST_COMPARED)
