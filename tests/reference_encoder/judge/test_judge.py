"""Views that played no part in encoding, and what pictures from them count for."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from reference_encoder.importance.view_sampling import (
    BESIDE,
    GIVEN,
    Views,
    ViewSet,
    judging_views,
    sample_views,
    views_of_kind,
)
from reference_encoder.judge.quality import Judge, Quality, cap_db, draw_gaussians, shows_something
from reference_encoder.options import EFFORTS, MIN_QUALITY, EncodeOptions
from reference_encoder.tuning import JUDGED_SHARES, LEAST_JUDGED_VIEWS
from scarfmt.render.camera import Camera, look_at, orbit_cameras
from scarfmt.render.viewpoints import KINDS, Upright, resolve_frame
from scarfmt.scene.gaussians import GaussianScene
from tests.render.scenes import random_scene

UP = np.array([0.0, -1, 0])


@pytest.fixture(scope="module")
def scene() -> GaussianScene:
    """Some Gaussians."""
    return random_scene(0, 300)


def _views(scene: GaussianScene, options: EncodeOptions, sight: ViewSet, count: int = 300) -> Views:
    return judging_views(scene, options, resolve_frame(scene, options.frame), sight, count)


def _outside(*cameras: Camera) -> Views:
    return Views({"orbit": cameras}, {"orbit": 1.0}, 1.0, Upright("-y"))


def _poses(views: Views) -> set[bytes]:
    return {camera.world_to_camera.tobytes() for camera in views.cameras}


@pytest.mark.parametrize("options", [EncodeOptions(effort=1), EncodeOptions(effort=2, frame="-y:90:40")])
@pytest.mark.parametrize("given", [False, True])
def test_survey_loop_and_report_look_from_different_places(
    scene: GaussianScene, options: EncodeOptions, given: bool
) -> None:
    """No set of views shows a view of another. Given cameras are surveyed themselves, and judged from beside."""
    options = replace(options, cameras=orbit_cameras(scene, 9)) if given else options
    surveyed = {camera.world_to_camera.tobytes() for camera in sample_views(scene, options).cameras}
    loop, report = (_poses(_views(scene, options, sight)) for sight in ViewSet)
    assert loop
    assert report
    assert not surveyed & loop
    assert not surveyed & report
    assert not loop & report


def test_kinds_of_places_count_by_shares_and_cameras_as_in_the_survey(scene: GaussianScene) -> None:
    """Everywhere by the shares of its kinds; with cameras mostly there and beside; with nothing else, nothing else."""
    cameras = orbit_cameras(scene, 9)
    for options in (EncodeOptions(), EncodeOptions(cameras=cameras), EncodeOptions(cameras=cameras, only_cameras=True)):
        views = _views(scene, options, ViewSet.TUNING)
        surveyed = sample_views(scene, options).shares
        assert set(views.views) == set(views.shares) == set(surveyed)
        assert sum(views.shares.values()) == pytest.approx(1)
        everywhere = sum(views.shares.get(kind, 0.0) for kind in KINDS)
        assert all(views.shares.get(kind, 0.0) == pytest.approx(everywhere * JUDGED_SHARES[kind]) for kind in KINDS)
        assert all(views.shares[kind] == surveyed[kind] for kind in (GIVEN, BESIDE) if kind in surveyed)


def test_photos_for_tests_are_left_to_tests(scene: GaussianScene) -> None:
    """If a camera list has a test split, only the other cameras are judging views."""
    here, there = orbit_cameras(scene, 2)
    options = EncodeOptions(cameras=[here, replace(there, split="test")])
    for camera in _views(scene, options, ViewSet.TUNING).views["given"]:
        assert np.linalg.norm(camera.centre - here.centre) < np.linalg.norm(camera.centre - there.centre)


def test_large_scenes_are_judged_by_fewer_views() -> None:
    """Small scenes have as many views as the effort says, larger ones fewer, down to a minimum."""
    options = EncodeOptions(effort=2)
    counts = [views_of_kind(options, gaussians) for gaussians in (1, 10**5, 10**6, 10**8)]
    assert counts[0] == EFFORTS[2].judged_views
    assert counts == sorted(counts, reverse=True)
    assert counts[-1] == LEAST_JUDGED_VIEWS


def _judge(scene: GaussianScene) -> Judge[GaussianScene]:
    views = _views(scene, EncodeOptions(effort=1), ViewSet.TUNING, 10**6)
    return Judge.of(scene, draw_gaussians, views, cap_db(40))


def test_pictures_are_compared_with_the_source(scene: GaussianScene) -> None:
    """The source itself counts for the most there is; a changed one is as far off as its pictures are."""
    judge = _judge(scene)
    assert judge.quality(scene).worst_db == cap_db(40)
    assert judge.quality(scene).mean_db == pytest.approx(cap_db(40))
    darker = judge.quality(replace(scene, sh=(scene.sh * np.float32(0.9))))
    assert 10 < darker.worst_db <= darker.low_db < darker.mean_db < 60
    assert set(darker.by_kind()) == set(KINDS)


def test_views_that_show_nothing_do_not_count(scene: GaussianScene) -> None:
    """Nothing in the picture of the source: no merit in nothing; a kind of only such views is left out."""

    def seen(towards: int) -> Camera:
        return look_at(np.array([0.0, 0, -9]), np.array([0.0, 0, -9 + towards]), UP, 40, 30)

    views = Views({"orbit": [seen(1), seen(-1)], "near": [seen(-1)]}, {"orbit": 0.5, "near": 0.5}, 1.0, Upright("-y"))
    judge = Judge.of(scene, draw_gaussians, views)
    found = judge.quality(replace(scene, sh=(scene.sh * np.float32(0.9))))
    assert len(found) == 1
    assert np.isfinite(found.mean_db)
    nothing = Judge.of(scene, draw_gaussians, _outside(seen(-1))).quality(scene)
    assert nothing.mean_db == nothing.worst_db == nothing.low_db == np.inf
    assert nothing.figures() == {"views": 0, "kinds": {}}


def test_views_of_next_to_nothing_do_not_count(scene: GaussianScene) -> None:
    """A picture that is nearly black is right whatever a file holds; it counts only where all are like that."""

    def seen(distance: float) -> Camera:
        return look_at(np.array([0.0, 0, -distance]), np.zeros(3), UP, 60, 45)

    near, far = seen(4), seen(400)
    assert draw_gaussians(scene)(far).any()
    assert len(Judge.of(scene, draw_gaussians, _outside(near, far)).quality(scene)) == 1
    assert len(Judge.of(scene, draw_gaussians, _outside(far)).quality(scene)) == 1
    assert shows_something(np.tile(np.float32([0, 0, 1]), (8, 8, 1))), "blue is something"


@pytest.mark.parametrize(("low", "lacking"), [(40.0, 0.0), (39.0, 1.0), (30.0, 1.5)])
def test_a_low_5th_percentile_counts_against_the_mean(low: float, lacking: float) -> None:
    """What it lacks of lying 6 dB below the mean is taken from that, 1.5 dB at most."""
    rest = np.full(19, (20 * 46.0 - low) / 19)
    found = Quality({"orbit": np.append(rest, low)}, {"orbit": 1.0})
    assert found.mean_db == pytest.approx(46)
    assert found.rated_db == pytest.approx(46 - lacking)


@pytest.mark.parametrize(("low", "looks"), [(26.0, 28.0), (22.0, 24.5)])
def test_a_layer_with_holes_looks_no_better_than_its_worse_places_allow(low: float, looks: float) -> None:
    """A fifth of the views at least 2.5 dB below the mean decides; better ones leave the mean alone."""
    rest = np.full(15, (20 * 28.0 - 5 * low) / 15)
    found = Quality({"orbit": np.append(rest, np.full(5, low))}, {"orbit": 1.0})
    assert found.mean_db == pytest.approx(28)
    assert found.preview_db == pytest.approx(looks)


def test_layers_are_looked_at_from_fewer_of_the_judging_views(scene: GaussianScene) -> None:
    """As many of each kind, no others than the judge has, and none counts for more than said."""
    judge = _judge(scene)
    few = judge.thin(4, 35.0)
    assert {kind: len(pairs) for kind, pairs in few.seen.items()} == dict.fromkeys(KINDS, 4)
    assert all(id(pair) in set(map(id, judge.seen[kind])) for kind, pairs in few.seen.items() for pair in pairs)
    assert few.quality(scene).mean_db == pytest.approx(35)
    counts = [len(pairs) for pairs in judge.seen.values()]
    assert all(len(pairs) >= min(counts) - 1 for pairs in judge.thin(min(counts) - 1, 35.0).seen.values())


def test_what_a_better_5th_percentile_costs_is_said() -> None:
    """The option that raises it, and by how much the file grows."""
    found = Quality({"orbit": np.append(np.full(19, 46.0), 30.0)}, {"orbit": 1.0})
    (said,) = found.shortfalls(45)
    assert "--worst 39" in said
    assert "84 %" in said
    poor = Quality({"orbit": np.full(20, 1.0)}, {"orbit": 1.0})
    assert f"--worst {MIN_QUALITY:g} raises" in poor.shortfalls(MIN_QUALITY)[1]
    for low in (46.0, 38.8):
        assert Quality({"orbit": np.append(np.full(19, 46.0), low)}, {"orbit": 1.0}).shortfalls(45) == []


@pytest.mark.parametrize(("kind", "place"), [(GIVEN, "near the cameras"), (BESIDE, "beside the cameras")])
def test_the_verdict_names_the_place_of_the_worst_view(kind: str, place: str) -> None:
    found = Quality({"orbit": np.array([40.0]), kind: np.array([30.0])}, {"orbit": 0.956, kind: 0.044})
    assert "from 95 % of places" in found.verdict()
    assert f"; worst {place}, 30.0 dB" in found.verdict()


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"quality": 45}, "9.0 dB below --quality 45: --quality 54 aims higher"),
        ({"quality": 38}, ""),
        ({"worst": 34}, "4.0 dB below --worst 34: --worst 38 aims higher"),
        ({"worst": 32}, ""),
        ({"quality": 45, "effort": 0}, "9.0 dB below --quality 45: --effort 1 comes closer"),
        ({"quality": 79}, "43.0 dB below --quality 79: --quality 80 aims higher"),
    ],
)
def test_a_target_that_is_missed_is_named_with_what_to_ask_for(asked: dict[str, Any], said: str) -> None:
    found = Quality({"orbit": np.append(np.full(9, 30.0), np.full(9, 42.0))}, {"orbit": 1.0})
    assert found.explain_miss(EncodeOptions(**asked)) == said
    assert Quality({}, {}).explain_miss(EncodeOptions(**asked)) == ""


def test_kinds_count_by_their_shares() -> None:
    """Mean and percentile weigh kinds, however many views of each are left; the worst is the worst."""
    found = Quality({"a": np.array([40.0]), "b": np.array([20.0, 30.0, 30.0, 40.0])}, {"a": 0.9, "b": 0.1})
    assert found.mean_db == pytest.approx(0.9 * 40 + 0.1 * 30)
    assert found.low_db == 30
    assert found.worst_db == 20
    assert found.error_db == pytest.approx(0.1 * (200 / 3 / 4) ** 0.5)  # of one view nothing is known
    assert found.figures()["kinds"]["b"] == {"views": 4, "mean_db": 30.0, "p5_db": 20.0, "worst_db": 20.0}
