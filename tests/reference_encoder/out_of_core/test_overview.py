"""A scene seen as a whole: few Gaussians stand for many, and settings that ranges cannot have are refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from reference_encoder.out_of_core.overview import judging_ranges, merge_runs, run_length, sample_evenly
from reference_encoder.tuning import JUDGING_RANGES, MOST_PROXIES
from scarfmt.render.camera import orbit_cameras
from scarfmt.render.rasterise import render
from tests.reference_encoder.out_of_core.chain import bounds_of, example, overviewed, partition


def test_a_run_of_one_is_that_gaussian() -> None:
    scene = example().with_sh_degree(0).take(np.arange(50))
    same, camera = merge_runs(scene, 1), orbit_cameras(example(), 1, 80, 60)[0]
    assert np.allclose(render(same, camera), render(scene, camera), atol=0.01)


def test_merged_gaussians_cover_about_as_much_with_the_same_colours() -> None:
    scene = example().with_sh_degree(0)
    order = np.argsort(bounds_of(scene).paths(scene.positions), kind="stable")
    few = merge_runs(scene.take(order), 16)
    assert len(few) == -(-len(scene) // 16)
    opaque = replace(scene.take(order), opacity_logits=np.full(len(scene), 30.0, np.float32))
    assert np.isfinite(merge_runs(opaque, 16).opacity_logits).all()
    many = replace(bounds_of(scene), count=10**10)
    assert 0.9 * MOST_PROXIES < many.count / run_length(many) <= MOST_PROXIES
    for camera in orbit_cameras(example(), 3, 80, 60):
        source, proxy = render(scene, camera), render(few, camera)
        assert abs(float(source.mean()) - float(proxy.mean())) < 0.25 * float(source.mean())


def test_a_range_is_drawn_with_proxies_of_the_others_only() -> None:
    ranges = partition(example(), 1200)
    overview = overviewed(example(), ranges)
    assert overview.options.frame == overview.survey.up.up
    part, scene = ranges[1]
    drawn = overview.make_drawable(part, scene).scene
    own = overview.edges[2] - overview.edges[1]
    assert own > 0
    assert len(drawn) == len(scene) + len(overview.proxies) - own
    assert drawn.sh.shape == (len(drawn), *scene.sh.shape[1:])


def test_rows_are_drawn_evenly() -> None:
    found = sample_evenly(1000, 0.1, 3)
    assert len(found) in (99, 100, 101)
    assert set(np.diff(found)) == {10}
    assert len(sample_evenly(5, 0.01, 3)) == 1
    assert sample_evenly(5, 2.0, 3).tolist() == [0, 1, 2, 3, 4]


def test_judging_ranges_are_different_and_spread() -> None:
    for count in (1, 2, 3, 8, 1000):
        found = judging_ranges(count, 7)
        assert len(set(found)) == len(found) == min(count, JUDGING_RANGES)
        assert all(0 <= number < count for number in found)
    assert np.ptp(found) > 500
