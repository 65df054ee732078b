"""Judging: levels over all views and by kind, bytes at equal quality, and the curve that bounds a set of files."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.judge import EQUAL_DB, LEVELS, bytes_at, equal_bytes, format_levels, judge, summarise, worst_kind
from benchmarks.time import bytes_at_equal_error
from benchmarks.trained import find_frontier
from benchmarks.views import View
from scarfmt.cli.scenes import Subject
from scarfmt.render.camera import look_at
from scarfmt.scene.gaussians import GaussianScene


def row(size: int, mean: float, low: float, worst: float) -> dict[str, Any]:
    return {"bytes": size, "psnr_db": mean, "p5_psnr_db": low, "worst_psnr_db": worst}


def test_a_summary_is_of_all_views_and_of_each_kind() -> None:
    found = summarise(["orbit", "orbit", "inside"], [44.0, 40.0, 36.0])
    assert (found["psnr_db"], found["worst_psnr_db"]) == (40.0, 36.0)
    assert 36 < found["p5_psnr_db"] < 37
    assert found["kinds"] == {"orbit": [42.0, 40.0], "inside": [36.0, 36.0]}
    assert worst_kind(found) == ("inside", 36.0)
    assert format_levels(found) == "40.0 / 36.4 / 36.0"


def test_equal_pictures_count_as_a_finite_level() -> None:
    none = np.zeros((0, 4), np.float32)
    scene = GaussianScene(np.zeros((0, 3)), none[:, :3], none, none[:, 0], np.zeros((0, 1, 3), np.float32))
    subject = Subject(lambda camera: np.zeros((camera.height, camera.width, 3), np.float32), scene)
    camera = look_at(np.ones(3), np.zeros(3), np.array([0, 0, 1.0]), 16, 16)
    found = judge(subject, subject, [View("near", camera)])
    assert found["psnr_db"] == found["worst_psnr_db"] == EQUAL_DB
    assert found["ssim"] == 1
    assert format_levels(found) == "equal"


def test_equal_bytes_lie_between_the_files_around_and_are_never_extrapolated() -> None:
    """The mean is reached at once, the worst view half way from the first file to the second."""
    files = [row(400, 50, 40, 38), row(100, 44, 36, 30)]
    assert equal_bytes(files, row(0, 40, 30, 34)) == pytest.approx(200)
    assert equal_bytes(files, row(0, 40, 30, 34), LEVELS[:1]) == 100
    assert equal_bytes(files, row(0, 50, 40, 39)) is None
    assert equal_bytes(files, row(0, 20, 20, 20)) == 100
    assert equal_bytes([], row(0, 20, 20, 20)) is None
    larger_but_worse = [row(100, 40, 40, 40), row(200, 44, 44, 44), row(300, 42, 42, 42)]
    assert equal_bytes(larger_but_worse, row(0, 44, 44, 44)) == pytest.approx(200)


def effort_run(effort: int, psnr: float, size: int) -> dict[str, Any]:
    return {"effort": effort, "psnr_db": psnr, "bytes": size}


def test_efforts_are_compared_where_all_have_files_on_both_sides() -> None:
    """At the best PSNR of the lower quality; halfway in dB is the geometric mean of bytes."""
    runs = [effort_run(1, 40.0, 100), effort_run(1, 44.0, 400), effort_run(2, 42.0, 150), effort_run(2, 43.0, 300)]
    goal, equal = bytes_at_equal_error(runs)
    assert goal == 42.0
    assert equal == pytest.approx({1: 200.0, 2: 150.0})
    with pytest.raises(ValueError, match="both sides"):
        bytes_at_equal_error([*runs[:1], effort_run(1, 41.0, 120), *runs[2:]])


POINTS = st.lists(st.tuples(st.integers(10, 40).map(float), st.integers(1, 1000).map(float)), min_size=1, max_size=12)


@given(POINTS)
def test_no_point_lies_below_the_frontier_and_it_bends_upwards(points: list[tuple[float, float]]) -> None:
    hull = find_frontier(points)
    assert set(hull) <= set(points)
    decibels, sizes = np.array(hull).T
    slopes = np.diff(np.log(sizes)) / np.diff(decibels)
    assert (np.diff(decibels) > 0).all()
    assert (slopes > 0).all()
    assert (np.diff(slopes) > -1e-9).all()
    for psnr, size in points:
        least = bytes_at(hull, max(psnr, decibels[0]))
        assert least is not None
        assert size >= least * (1 - 1e-9)


def test_between_two_points_lies_their_line_and_beyond_them_nothing() -> None:
    hull = find_frontier([(20.0, 100.0), (22.0, 400.0), (21.0, 250.0), (19.0, 120.0)])
    assert hull == [(20.0, 100.0), (22.0, 400.0)]
    assert bytes_at(hull, 21.0) == pytest.approx(200.0)
    assert bytes_at(hull, 19.9) is None
    assert bytes_at(hull, 22.1) is None
    assert bytes_at([], 22.1) is None
