"""A scene of a single range is measured and judged as it is in memory; in several, about so."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from reference_encoder.judge.finished import finished_gaussians
from reference_encoder.judge.judge import Judge, gaussian_view
from reference_encoder.judge.quality import most_db
from reference_encoder.judge.views import Sight
from reference_encoder.measure.survey import survey
from reference_encoder.measure.weights import weighed
from reference_encoder.scale import judged
from reference_encoder.scale import measured as module
from reference_encoder.scale.applied import apply
from reference_encoder.scale.judged import judge, pictures, piece, quality_of
from reference_encoder.scale.measured import measure, met
from scarfmt.render.camera import look_at
from tests.reference_encoder.scale.chain import OPTIONS, cut, encoded, example, overviewed


def test_one_range_weighs_what_the_scene_does(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("RANGE_VIEWS", "RANGE_ORBITS"):
        monkeypatch.setattr(module, name, {1: 1000})
    ranges = cut(example(), len(example()))
    part, scene = ranges[0]
    found = measure(overviewed(example(), ranges), part, scene)
    expected = weighed(scene, survey(scene, OPTIONS))
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
    return weighed(example(), survey(example(), OPTIONS)).colour


def test_one_range_is_judged_as_the_scene_is() -> None:
    chain = encoded(1200)
    ranges = cut(example(), len(example()))
    overview, (part, scene) = overviewed(example(), ranges), ranges[0]
    weights = measure(overview, part, scene)
    shown = pictures(overview, part, scene, weights)
    found = quality_of(overview, [judge(overview, chain.fit, part, shown)])
    content = apply(overview, chain.fit, part, scene, weights)
    views = overview.views[Sight.LOOP]
    expected = Judge.of(scene, gaussian_view, views, most_db(OPTIONS.asked_db))
    assert found.mean_db == pytest.approx(expected.quality(finished_gaussians(chain.fit.scene(content))).mean_db)


def test_a_piece_of_a_range_and_proxies_of_the_rest_stand_for_all(monkeypatch: pytest.MonkeyPatch) -> None:
    chain = encoded(1200)
    part, scene = chain.ranges[1]
    whole, runs = piece(chain.overview, part, scene)
    assert sorted(whole) == list(range(len(scene)))
    assert runs == (0, chain.overview.edges[2] - chain.overview.edges[1])
    monkeypatch.setattr(judged, "JUDGED_ROWS", 3 * chain.overview.run)
    rows, (first, past) = piece(chain.overview, part, scene)
    assert past - first == 3
    assert np.array_equal(rows, whole[first * chain.overview.run : past * chain.overview.run])
    drawn = chain.overview.drawn(part, scene.take(rows), (first, past)).scene
    assert len(drawn) == len(rows) + len(chain.overview.proxies) - 3


def test_views_that_look_away_do_not_meet_a_range() -> None:
    eye, up = np.array([0.0, 0.0, -10.0]), np.array([0.0, -1.0, 0.0])
    towards = look_at(eye, example().positions.mean(axis=0), up, 80, 60)
    away = look_at(eye, eye + np.array([0.0, 0.0, -1.0]), up, 80, 60)
    assert met([away, towards], example()).tolist() == [1]
