"""Judging: mean, low end and worst over all views and by kind, and the tables that are made of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks import quality_report
from benchmarks.judged import EQUAL_DB, judgement, kinds_text, levels_text, summary, worst_kind
from benchmarks.views import View
from scarfmt.cli.scenes import Subject
from scarfmt.render.camera import look_at
from scarfmt.scene.gaussians import GaussianScene

LEVELS = summary(["orbit", "orbit", "inside"], [44.0, 40.0, 36.0])


def test_summary_is_of_all_views_and_of_each_kind() -> None:
    assert LEVELS["psnr_db"] == 40.0
    assert LEVELS["worst_psnr_db"] == 36.0
    assert 36 < LEVELS["p5_psnr_db"] < 37
    assert LEVELS["kinds"] == {"orbit": [42.0, 40.0], "inside": [36.0, 36.0]}
    assert worst_kind(LEVELS) == ("inside", 36.0)
    assert levels_text(LEVELS) == "40.0 / 36.4 / 36.0"
    assert kinds_text(LEVELS) == ["42.0 / 40.0", "", "36.0 / 36.0", ""]


def test_equal_pictures_count_as_so_much() -> None:
    """Without infinity in a mean; and a scene against itself is equal, whatever the kinds."""
    empty = np.zeros((0, 3))
    scene = GaussianScene(empty, empty, np.zeros((0, 4)), np.zeros(0), np.zeros((0, 1, 3)))
    subject = Subject(lambda camera: np.zeros((camera.height, camera.width, 3), np.float32), scene)
    camera = look_at(np.ones(3), np.zeros(3), np.array([0, 0, 1.0]), 16, 16)
    found = judgement(subject, subject, [View("near", camera)])
    assert found["psnr_db"] == found["worst_psnr_db"] == EQUAL_DB
    assert found["ssim"] == 1
    assert levels_text(found) == "equal"


def layer(size: int, level: float) -> dict[str, Any]:
    found = summary(["orbit", "near", "inside"], [level + 1, level, level - 1])
    return {"bytes": size, "bytes_per_source": size / 1000, **found, "ssim": 0.9, "photos_psnr_db": None, "streams": {}}


def run(name: str, quality: float, *layers: dict[str, Any], whole: bool = False) -> dict[str, Any]:
    facts = {"scene": name, "note": "n", "quality": quality, "effort": 2, "whole": whole, "profile": "explicit"}
    costs = {"encode_seconds": 1.0, "encode_peak_bytes": 1, "decode_seconds": 0.1, "decode_peak_bytes": 1}
    source = {"source_count": 1000, "source_bytes": 248_000, "source_photos_psnr_db": None}
    return {**facts, **source, **costs, "layers": list(layers)}


RUNS = [
    run("plush-dog", 47.0, layer(900, 26.0), layer(9000, 46.5)),
    run("plush-dog", 41.0, layer(800, 25.0), layer(5000, 36.0)),
    run("plush-dog", 52.0, layer(20000, 52.5), whole=True),
]


def test_what_was_asked_is_bold_where_it_was_given() -> None:
    text = quality_report.asked(quality_report.ordered(RUNS))
    assert "| plush-dog † | 41 | 5.00 | 36.0 | 35.1 | 35.0 | inside 35.0 |  |" in text
    assert "| plush-dog † | 47 | 9.00 | **46.5** | **45.6** | 45.5 | inside **45.5** |  |" in text


def test_headline_is_one_file_a_scene_beside_rivals_with_their_defaults() -> None:
    """Figures of other files and of tuned rivals do not stand beside it; a rival not measured is left empty."""
    rivals = [{"name": "SPZ v4", **layer(20_000, 30.0)}, {"name": "SPZ v4, times 2", **layer(9_000, 47.0)}]
    text = quality_report.summary(RUNS, {"plush-dog": {"sh_degree": 3, "count": 1000, "rivals": rivals}})
    assert "| plush-dog † | 3 | 248 | 9 | 46.5 / 45.5 | 20 | 30.0 / 29.0 |  |  |" in text
    assert text.count("\n| plush-dog") == 1


def test_equal_quality_is_against_the_smallest_rival_whatever_its_settings() -> None:
    """Files for 41 and 47 dB lie around a mean of 45; none is as good as a worst view of 80 dB."""
    rival = {"name": "SPZ v4, times 2", **layer(20_000, 45.0), "worst_psnr_db": 80.0}
    found = {"plush-dog": {"sh_degree": 3, "count": 1000, "rivals": [rival]}}
    text = quality_report.summary(RUNS, found)
    assert "with its mean takes 0.41 to 0.41 of its bytes on 1 scenes of 1." in text
    assert "the worst view takes none." in text


def test_tables_show_whole_files_without_layers() -> None:
    text = quality_report.tables(RUNS)
    assert "| 47 | 1 | 900 |" in text
    assert "| 52 | all | 20,000 |" in text
