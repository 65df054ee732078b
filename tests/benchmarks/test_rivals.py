"""The benchmark against rivals: its writers, readers and choices are right, and its tables say what was measured."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import rivals_report, rivals_run, rivals_tools
from benchmarks.judged import summary
from benchmarks.report import replace_section
from benchmarks.rivals_formats import formats, read, splat_rows, spz_scale, write_job
from benchmarks.rivals_kmeans import kmeans, nearest
from benchmarks.rivals_tools import Command, ToolFailed, measured
from benchmarks.scenes import chosen
from scarfmt.formats.export_ply import write_inria_ply
from scarfmt.scene.gaussians import GaussianScene


def scene(count: int = 200, degree: int = 3, seed: int = 1) -> GaussianScene:
    random = np.random.default_rng(seed)
    rotations = random.normal(size=(count, 4))
    return GaussianScene(
        random.normal(size=(count, 3)).astype(np.float32).astype(np.float64),
        random.uniform(-8, -2, (count, 3)).astype(np.float32),
        (rotations / np.linalg.norm(rotations, axis=1, keepdims=True)).astype(np.float32),
        random.uniform(-4, 4, count).astype(np.float32),
        random.normal(scale=0.1, size=(count, (degree + 1) ** 2, 3)).astype(np.float32),
    )


def layer(size: int, psnr_db: float) -> dict[str, Any]:
    """Seen from two views: one a decibel better, one a decibel worse."""
    levels = summary(["orbit", "inside"], [psnr_db + 1, psnr_db - 1])
    return {"bytes": size, **levels, "ssim": 0.99, "photos_psnr_db": None}


COSTS = {"encode_seconds": 1.0, "decode_seconds": 0.1, "encode_peak_bytes": 2**20, "decode_peak_bytes": 2**20}


def rival(name: str, size: int, psnr_db: float, family: str = "spz") -> dict[str, Any]:
    return {"name": name, "family": family, "reader": "r", **COSTS, **layer(size, psnr_db)}


def run(**changes: Any) -> dict[str, Any]:
    return {
        "scene": "s",
        "note": "n",
        "count": 100,
        "sh_degree": 3,
        "source_bytes": 9000,
        "skipped": [],
        "rivals": [rival("SPZ v4", 2000, 37.0), rival("SOG", 2400, 43.0, "sog"), rival("fine", 4000, 50.0)],
        "scar": [
            {"quality": 41.0, "whole": False, **COSTS, "layers": [layer(150, 26.0), layer(1000, 41.0)]},
            {
                "quality": 47.0,
                "whole": False,
                **COSTS,
                "layers": [layer(400, 31.0), layer(1200, 43.5), layer(1440, 47)],
            },
        ],
        **changes,
    }


def test_rows_of_splat_are_read_back_by_the_importer(tmp_path: Path) -> None:
    """Each value within what its eight bits allow, and those that cover most come first."""
    source = scene(degree=0)
    path = tmp_path / "a.splat"
    path.write_bytes(splat_rows(source))
    found = read(path)
    covering = source.log_scales.sum(axis=1) - np.log1p(np.exp(-source.opacity_logits))
    order = np.argsort(-covering, kind="stable")
    assert np.array_equal(found.positions, source.positions[order])
    assert np.abs(found.log_scales - source.log_scales[order]).max() < 1e-5
    # Truncated to eight bits, as its own converter does: at most one step.
    assert np.abs(np.abs((found.rotations * source.rotations[order]).sum(axis=1)) - 1).max() < 0.02
    alphas = [1 / (1 + np.exp(-logits)) for logits in (found.opacity_logits, source.opacity_logits[order])]
    assert np.abs(alphas[0] - alphas[1]).max() < 1.01 / 255


def test_zstd_of_a_ply_gives_the_scene_back(tmp_path: Path) -> None:
    source = scene()
    ply, out = tmp_path / "a.ply", tmp_path / "a.ply.zst"
    write_inria_ply(source, ply)
    write_job({"kind": "ply-zstd", "source": str(ply), "out": str(out)})
    found = read(out)
    assert np.array_equal(found.sh, source.sh)
    assert np.array_equal(found.positions, source.positions)
    assert out.stat().st_size < ply.stat().st_size


def test_reading_undoes_the_scale(tmp_path: Path) -> None:
    source = scene()
    path = tmp_path / "a.ply"
    large = GaussianScene(
        source.positions * 32,
        source.log_scales + np.float32(np.log(32)),
        source.rotations,
        source.opacity_logits,
        source.sh,
    )
    write_inria_ply(large, path)
    found = read(path, 32)
    assert np.array_equal(found.positions, source.positions)
    assert np.abs(found.log_scales - source.log_scales).max() < 1e-5


@pytest.mark.parametrize("size", [1e-3, 1.0, 5e3])
def test_scale_for_spz_keeps_the_scene_in_its_range(size: float) -> None:
    """Whatever the size of the scene: no coordinate and no scale is clipped at the top, and it is a power of two."""
    source = scene()
    moved = np.float32(np.log(size))
    source = GaussianScene(
        source.positions * size, source.log_scales + moved, source.rotations, source.opacity_logits, source.sh
    )
    scale = spz_scale(source, 32)
    assert np.log2(scale) % 1 == 0
    assert np.abs(source.positions).max() * scale <= 2047
    assert source.log_scales.max() + np.log(scale) <= 255 / 16 - 10 + 1e-6


def test_settings_have_names_of_their_own() -> None:
    """Names are keys of tables and of kept files."""
    for degree, few in ((3, False), (3, True), (0, False)):
        found = formats(scene(degree=degree), few)
        assert len({each.name for each in found}) == len(found)
        commands = {repr(each.command(Path("in.ply"), Path("out"))) for each in found if each.family == "spz"}
        assert len(commands) == sum(each.family == "spz" for each in found)
    assert len(formats(scene(degree=0))) < len(formats(scene()))


def test_kept_files_have_places_of_their_own() -> None:
    """No setting gets the file of another, or of another scene."""
    example = chosen(["plush-toys"])[0]
    found = formats(scene())
    paths = {rivals_run.kept_file(example, example.path, each) for each in found}
    assert len(paths) == len(found)
    other = example.captured
    assert other is not None
    assert not paths & {rivals_run.kept_file(example, other, each) for each in found}


def test_nearest_is_exact() -> None:
    """Against all distances in float64, over several tiles of centroids and of points."""
    random = np.random.default_rng(2)
    points, centroids = (random.normal(size=(count, 9)).astype(np.float32) for count in (300, 2100))
    distances = ((points[:, None].astype(np.float64) - centroids[None]) ** 2).sum(axis=2)
    found = distances[np.arange(len(points)), nearest(points, centroids)]
    assert np.abs(found - distances.min(axis=1)).max() < 1e-5


def test_kmeans_moves_centroids_to_the_middle_of_their_points() -> None:
    random = np.random.default_rng(3)
    middles = np.array([[0, 0], [10, 0], [0, 10]], np.float32)
    points = (np.repeat(middles, 50, axis=0) + random.normal(scale=0.1, size=(150, 2))).astype(np.float32)
    centroids, labels = kmeans(points, points[[0, 60, 120]], 3)
    assert np.abs(centroids - middles).max() < 0.1
    assert np.array_equal(labels, np.repeat([0, 1, 2], 50))


def test_kmeans_gives_an_idle_centroid_a_point() -> None:
    points = np.array([[0.0], [1.0], [2.0]], np.float32)
    centroids, _ = kmeans(points, np.array([[1.0], [1000.0]], np.float32), 1)
    assert centroids[1, 0] in points


def test_measured_tells_the_peak_of_the_process_alone() -> None:
    """The peak does not include this large process, from which the counters of a child start."""
    ballast = np.ones(60_000_000, np.uint8)
    small = measured(Command((sys.executable, "-S", "-c", "pass"), {}))
    large = measured(Command((sys.executable, "-S", "-c", "b'1' * 50_000_000"), {}))
    assert small.peak_bytes < 40_000_000 < large.peak_bytes
    assert len(ballast)


def test_measured_passes_the_environment_on_and_failure_back() -> None:
    program = "import os, sys; sys.stderr.write('said ' + os.environ['WORD']); sys.exit(3)"
    with pytest.raises(ToolFailed, match=r"ended with 3: said why"):
        measured(Command((sys.executable, "-c", program), {"WORD": "why"}))


def test_no_node_is_a_reason_and_no_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(os.environ, "PATH", "")
    assert rivals_tools.install() == "node and npm are not installed"


def test_verdicts_are_at_equal_quality() -> None:
    """43 dB lie a third of the way from 41 to 47: 1000 * 1.44 ** (1 / 3); what is not reached is said."""
    text = rivals_report.verdicts([run()])
    assert "| s | 3 | SPZ v4 | 20.00 | 37.0 / 36.1 / 36.0 | ≤ 10.00 | **≤ 0.50** | ≤ 10.00 | **≤ 0.50** |" in text
    assert "| s | 3 | SOG | 24.00 | 43.0 / 42.1 / 42.0 | 11.29 | **0.47** | 11.29 | **0.47** |" in text
    assert "| s | 3 | fine | 40.00 | 50.0 / 49.1 / 49.0 | not reached |  | not reached |  |" in text


def test_first_picture_is_a_share_of_the_smallest_rival_that_has_one() -> None:
    blurred = run(rivals=[rival("blurred", 500, 24.0), *run()["rivals"]])
    assert "| s | 3 | 0 | SPZ v4 | 2 | **8%** |" in rivals_report.verdicts([blurred])


def test_no_good_rival_is_said() -> None:
    lone = run(rivals=[rival("poor", 500, 20.0)])
    assert "| none |" in rivals_report.verdicts([lone])


def test_aims_differ_with_and_without_harmonics() -> None:
    """A ratio of 0.56 is aimed at where colours do not depend on the view."""
    close = [rival("SPZ v4", 1800, 38.0)]
    assert "**≤ 0.56**" not in rivals_report.verdicts([run(rivals=close)])
    assert "**≤ 0.56**" in rivals_report.verdicts([run(rivals=close, sh_degree=0)])


def test_tables_show_every_file_that_is_not_beaten_and_what_was_skipped() -> None:
    beaten = rival("SPZ v4, worse", 5000, 49.0)
    text = rivals_report.scenes([run(rivals=[*run()["rivals"], beaten], skipped=[{"name": "x", "why": "no node"}])])
    assert "worse" not in text
    assert "Skipped: x (no node)." in text
    for name in ("SPZ v4", "SOG", "fine", "quality 41", "quality 47"):
        assert name in text


def test_results_of_some_formats_keep_the_others() -> None:
    new = run(rivals=[rival("SOG", 2300, 42.0, "sog")])
    skipped = [{"name": name, "family": name, "why": "w"} for name in ("spz", "sog")]
    found = rivals_run.merged(run(skipped=skipped), new, ["sog"])
    assert found["skipped"] == skipped[:1]
    assert [each["bytes"] for each in found["rivals"]] == [2000, 2300, 4000]
    assert len(found["scar"]) == 2


def test_plot_is_drawn_small(tmp_path: Path) -> None:
    rivals_report.plots([run(), run(scene="plain", sh_degree=0)], tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["rivals-s.svg"]
    text = (tmp_path / "rivals-s.svg").read_text(encoding="utf-8")
    assert ".scar layers, quality 41" in text
    assert len(text) < 40_000


def test_page_has_the_markers(tmp_path: Path) -> None:
    copy = tmp_path / "page.md"
    copy.write_text(rivals_report.PAGE.read_text(encoding="utf-8"), encoding="utf-8")
    for name in ("rivals-verdicts", "rivals-scenes"):
        replace_section(name, "text", copy)
    assert copy.read_text(encoding="utf-8").count("\ntext\n") == 2
