"""Kept files: which are used again, and which are out of date; jobs in processes of their own, and their times."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import child, encoded, quality
from benchmarks.scenes import Scene
from scarfmt.cli.scenes import Subject
from scarfmt.scene.gaussians import GaussianScene


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Scene]:
    """A scene, and an encoder whose whole source is one small file."""
    for name in ("reference_encoder", "scarfmt/cli"):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "it.py").write_text("1")
    (tmp_path / "a.ply").write_text("splats")
    monkeypatch.setattr(encoded, "REPOSITORY", tmp_path)
    monkeypatch.setattr(encoded, "SCRATCH", tmp_path / "kept")
    _forget()
    yield Scene("a scene", tmp_path / "a.ply")
    _forget()


def _forget() -> None:
    encoded.source_key.cache_clear()
    encoded.file_key.cache_clear()


def test_a_path_tells_everything_a_file_depends_on(scene: Scene, tmp_path: Path) -> None:
    """Scene, quality, effort and cameras: each gives another path, the same ones the same path."""
    (tmp_path / "cameras.json").write_text("[]")
    paths = {
        encoded.encoded_path(scene, 41.0, 2),
        encoded.encoded_path(scene, 47.0, 2),
        encoded.encoded_path(scene, 41.0, 1),
        encoded.encoded_path(replace(scene, known=tmp_path / "cameras.json"), 41.0, 2),
    }
    assert len(paths) == 4
    assert encoded.encoded_path(scene, 41.0, 2) in paths


@pytest.mark.parametrize("changed", ["reference_encoder/it.py", "a.ply"])
def test_a_change_of_the_encoder_or_of_the_scene_makes_files_stale(scene: Scene, tmp_path: Path, changed: str) -> None:
    before = encoded.encoded_path(scene, 41.0, 2)
    (tmp_path / changed).write_text("2")
    _forget()
    assert encoded.encoded_path(scene, 41.0, 2) != before


def test_the_command_line_is_no_part_of_the_encoder(scene: Scene, tmp_path: Path) -> None:
    before = encoded.encoded_path(scene, 41.0, 2)
    (tmp_path / "scarfmt/cli/it.py").write_text("2")
    _forget()
    assert encoded.encoded_path(scene, 41.0, 2) == before


def test_a_file_that_is_there_is_not_encoded_again(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """The second time, what is known of it comes from beside it; without that note it is encoded again."""
    jobs: list[dict[str, Any]] = []

    def run(**job: Any) -> dict[str, Any]:
        jobs.append(job)
        Path(job["out"]).write_bytes(b"scar")
        child.note_path(Path(job["out"])).write_text(json.dumps({"seconds": len(jobs), "bytes": 4}))
        return {}

    monkeypatch.setattr(child, "run", run)
    first, second = (encoded.encoded(scene, 41.0, 2) for _ in range(2))
    assert first == second == {"path": jobs[0]["out"], "seconds": 1, "bytes": 4}
    assert len(jobs) == 1
    child.note_path(Path(first["path"])).unlink()
    assert encoded.encoded(scene, 41.0, 2)["seconds"] == 2


def test_pictures_of_a_file_are_compared_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Until the decoder's source changes; its last layer alone is another question."""
    compared: list[int] = []
    monkeypatch.setattr(quality, "load_subject", lambda _name: Subject(placed_at(3), placed_at(3)))
    monkeypatch.setattr(quality, "layer_table", lambda _name: [{"layer": 1}, {"layer": 2}])
    monkeypatch.setattr(quality, "_layer", lambda *of: compared.append(of[-1]["layer"]) or {"psnr_db": 40.0})
    monkeypatch.setattr(Scene, "judged_views", lambda *_of: [])
    scene, path = Scene("a scene", tmp_path / "a.ply"), tmp_path / "a.scar"
    first, second = (quality.distortion(scene, path) for _ in range(2))
    assert first == second == {"source_photos_psnr_db": None, "layers": [{"psnr_db": 40.0}] * 2}
    assert compared == [1, 2]
    quality.distortion(scene, path, whole=True)
    assert compared == [1, 2, 2]
    monkeypatch.setattr(quality, "source_key", lambda _packages: "another decoder")
    quality.distortion(scene, path)
    assert compared == [1, 2, 2, 1, 2]


def placed_at(count: int) -> GaussianScene:
    """A scene of nothing but positions."""
    zeros = np.zeros((count, 4), np.float32)
    return GaussianScene(np.zeros((count, 3)), zeros[:, :3], zeros, zeros[:, 0], np.zeros((count, 1, 3), np.float32))


def test_runs_stop_by_number_or_by_time() -> None:
    """At least one, and none begun when the time is up."""
    assert len(child.timed(lambda: None, runs=4, seconds=60.0)["walls"]) == 4
    found = child.timed(lambda: None, runs=4, seconds=0.0)
    assert len(found["walls"]) == len(found["cpus"]) == 1
    assert found["seconds"] == found["walls"][0]


def test_what_is_compared_takes_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    """Least, median and least processor time over all rounds; variables of the job win over those of all children."""
    seen: list[tuple[str, str]] = []
    walls = iter([[5.0, 3.0], [9.0], [4.0, 8.0], [7.0]])

    def run(environment: dict[str, str], job: str) -> dict[str, Any]:
        seen.append((job, environment["OMP_NUM_THREADS"]))
        now = next(walls)
        return {"walls": now, "cpus": [2 * wall for wall in now], "peak_bytes": len(seen), "count": 6, "seconds": 0.0}

    monkeypatch.setattr(child, "run", run)
    jobs = {"one": {"job": "a"}, "two": {"job": "b", "environment": {"OMP_NUM_THREADS": "8"}}}
    found = child.in_turns(jobs, 2)
    assert seen == [("a", "1"), ("b", "8")] * 2
    assert found["one"] == {"count": 6, "min": 3.0, "median": 4.5, "cpu": 6.0, "runs": 4, "peak_bytes": 1}
    assert found["two"]["median"] == 8.0


def test_a_job_in_a_process_of_its_own_tells_its_peak() -> None:
    """By MODULE:FUNCTION; whatever else is printed before is no part of the report."""
    found = child.run({"SCARFMT_TEST": "x"}, job="tests.benchmarks.test_encoded:echo", value=3)
    assert found["value"] == 3
    assert found["variable"] == "x"
    assert found["peak_bytes"] > 1 << 20


def echo(job: dict[str, Any]) -> dict[str, Any]:
    """The job that the test above gives to a child."""
    import os

    print("something a library has to say")
    return {"value": job["value"], "variable": os.environ["SCARFMT_TEST"]}
