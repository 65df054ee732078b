"""Judging: levels over all views and by kind, bytes at equal quality, and the tables made of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchmarks.judge import EQUAL_DB, LEVELS, equal_bytes, format_levels, judge, summarise, worst_kind
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
