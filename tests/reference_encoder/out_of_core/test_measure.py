"""A scene of a single range is measured and judged as it is in memory; in several, about so.

Views that tell much of what Gaussians weigh are drawn more likely, and count as often as they were unlikely.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from reference_encoder.importance.view_sampling import ViewSet
from reference_encoder.importance.view_sampling import sample_views as survey_views
from reference_encoder.importance.weights import Weights, weigh_scene
from reference_encoder.judge.quality import Judge, cap_db, draw_gaussians
from reference_encoder.judge.reconstruct import reconstruct_gaussians
from reference_encoder.out_of_core import judge as judging
from reference_encoder.out_of_core import measure as module
from reference_encoder.out_of_core.fit import apply
from reference_encoder.out_of_core.judge import choose_piece, combine_quality, judge, render_pictures
from reference_encoder.out_of_core.measure import estimate_shares, find_meeting_views, measure, sample_views
from reference_encoder.tuning import LEAST_COVER
from scarfmt.render.camera import look_at
from tests.reference_encoder.out_of_core.chain import OPTIONS, encoded, example, overviewed, partition


def test_one_range_weighs_what_the_scene_does(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("RANGE_VIEWS", "RANGE_ORBITS"):
        monkeypatch.setattr(module, name, {1: 1000})
    ranges = partition(example(), len(example()))
    part, scene = ranges[0]
    found = measure(overviewed(example(), ranges), part, scene)
    expected = weigh_scene(scene, survey_views(scene, OPTIONS))
    assert np.allclose(found.shape, expected.shape, rtol=1e-3)
    assert np.allclose(found.colour, expected.colour, rtol=1e-3)
    assert np.array_equal(found.largest, expected.largest)


def test_ranges_weigh_about_what_they_do_in_the_scene() -> None:
    chain = encoded(1200)
    logs = []
    for (_, scene), found in zip(chain.ranges, chain.measured, strict=True):
        place = {tuple(row): number for number, row in enumerate(example().positions.tolist())}
        rows = np.array([place[tuple(row)] for row in scene.positions.tolist()])
        logs.append(np.log10((found.colour + 1e-20) / (whole_colours()[rows] + 1e-20)))
    off = np.concatenate(logs)
    assert abs(float(np.median(off))) < 0.15
    assert float(np.percentile(np.abs(off), 90)) < 1.0


@lru_cache
def whole_colours() -> np.ndarray:
    """What all Gaussians of the example weigh, measured together."""
    return weigh_scene(example(), survey_views(example(), OPTIONS)).colour


def test_one_range_is_judged_as_the_scene_is() -> None:
    chain = encoded(1200)
    ranges = partition(example(), len(example()))
    overview, (part, scene) = overviewed(example(), ranges), ranges[0]
    weights = measure(overview, part, scene)
    shown = render_pictures(overview, part, scene, weights)
    found = combine_quality(overview, [judge(overview, chain.fit, part, shown)])
    whole, _ = apply(overview, chain.fit, part, scene, weights)
    views = overview.views[ViewSet.TUNING]
    expected = Judge.of(scene, draw_gaussians, views, cap_db(OPTIONS.asked_db))
    assert found.mean_db == pytest.approx(expected.quality(reconstruct_gaussians(whole)).mean_db)
    unseen = Weights(*map(np.zeros_like, vars(shown.measured).values()))
    nothing = judge(overview, chain.fit, part, replace(shown, measured=unseen))
    assert combine_quality(overview, [nothing]).mean_db < 20, "of which nothing is sent"


@pytest.mark.parametrize(("ranges", "cover", "error"), [(1, 0.5, 2e-4), (2, 0.5, 2e-4), (3, 0.5, 3e-4)])
def test_the_rest_of_a_picture_errs_as_the_part_that_is_judged(ranges: int, cover: float, error: float) -> None:
    """Parts that cover more than the picture are all of it; of what hardly covers any nothing is known."""
    overview = encoded(1200).overview
    cameras = len(overview.views[ViewSet.TUNING].cameras)
    judged = np.tile([[1e-4], [cover]], cameras)
    found = combine_quality(overview, [judged] * ranges)
    assert (len(found), found.mean_db) == (cameras, pytest.approx(-10 * np.log10(error)))
    judged[1, 0] = LEAST_COVER / 4
    assert len(combine_quality(overview, [judged] * ranges)) == cameras - 1


def test_a_piece_of_a_range_and_proxies_of_the_rest_stand_for_all(monkeypatch: pytest.MonkeyPatch) -> None:
    chain = encoded(1200)
    part, scene = chain.ranges[1]
    whole, runs = choose_piece(chain.overview, part, scene)
    assert sorted(whole) == list(range(len(scene)))
    assert runs == (0, chain.overview.edges[2] - chain.overview.edges[1])
    cover = render_pictures(chain.overview, part, scene, measure(chain.overview, part, scene)).cover
    assert 0 < cover.min() < 0.9  # proxies of other ranges make up the rest
    monkeypatch.setattr(judging, "JUDGED_ROWS", 3 * chain.overview.run)
    rows, (first, past) = choose_piece(chain.overview, part, scene)
    assert past - first == 3
    assert np.array_equal(rows, whole[first * chain.overview.run : past * chain.overview.run])
    drawn = chain.overview.make_drawable(part, scene.take(rows), (first, past)).scene
    assert len(drawn) == len(rows) + len(chain.overview.proxies) - 3


def test_views_that_look_away_do_not_meet_a_range() -> None:
    eye, up = np.array([0.0, 0.0, -10.0]), np.array([0.0, -1.0, 0.0])
    towards = look_at(eye, example().positions.mean(axis=0), up, 80, 60)
    away = look_at(eye, eye + np.array([0.0, 0.0, -1.0]), up, 80, 60)
    assert find_meeting_views([away, towards], example()).tolist() == [1]


def test_all_views_are_drawn_where_they_may_be_and_count_once() -> None:
    numbers, times = sample_views(np.array([0.2, 0.0, 0.7, 1e-9]), 3)
    assert numbers.tolist() == [0, 2, 3]
    assert times.tolist() == [1, 1, 1]
    assert len(sample_views(np.zeros(5), 3)[0]) == 0
    assert len(sample_views(np.zeros(0), 3)[0]) == 0


@pytest.mark.parametrize("most", [1, 5, 16])
def test_as_many_are_drawn_as_asked_for_and_stand_for_about_all(most: int) -> None:
    shares = np.random.default_rng(0).pareto(1.0, 100)
    numbers, times = sample_views(shares, most)
    assert len(set(numbers.tolist())) == len(numbers) == most
    assert (times >= 1).all()
    # What a sum over the shares themselves would be, but for the last view drawn.
    assert shares[numbers] @ times == pytest.approx(shares.sum(), rel=1 / most)


def test_a_view_that_tells_nearly_all_stands_for_itself_alone() -> None:
    shares = np.full(50, 1.0)
    shares[20] = 1000.0
    numbers, times = sample_views(shares, 4)
    assert times[numbers.tolist().index(20)] == 1
    assert np.allclose(times[numbers != 20], 49 / 3)


def test_near_views_tell_more_than_far_ones_and_those_that_look_away_nothing() -> None:
    middle, up = example().positions.mean(axis=0), np.array([0.0, -1.0, 0.0])
    span = float(np.ptp(example().positions, axis=0).max())
    eyes = [middle + np.array([0.0, 0.0, -away * span]) for away in (1, 6)]
    near, far = (look_at(eye, middle, up, 1280, 960) for eye in eyes)
    aside = look_at(eyes[0], eyes[0] + np.array([0.0, 0.0, -1.0]), up, 1280, 960)
    shares = estimate_shares(example(), [far, near, aside])
    assert shares.sum() == pytest.approx(1)
    assert shares[1] > 3 * shares[0] > 0
    assert shares[2] == 0
