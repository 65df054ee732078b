"""Results: cached files are never stale, children report themselves, provenance covers every figure of every page."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from benchmarks import child, encode_cache, provenance, quality
from benchmarks.provenance import EVERYTHING, FIELD, MEASURED, Run, figures, group_runs, stamp, statement
from benchmarks.report import COSTS_PAGE, RESULTS_PAGE, load_document, load_results
from benchmarks.scenes import REPOSITORY, Scene

FILES = sorted(path for folder in ("benchmarks", "fuzz") for path in (REPOSITORY / folder / "results").glob("*.json"))
MORE_BYTES, LESS_DB = 1.10, 0.5


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Scene]:
    """A scene, and an encoder whose whole source is one small file."""
    for name in ("reference_encoder", "scarfmt/cli"):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "it.py").write_text("1")
    (tmp_path / "a.ply").write_text("splats")
    monkeypatch.setattr(encode_cache, "REPOSITORY", tmp_path)
    monkeypatch.setattr(encode_cache, "SCRATCH", tmp_path / "kept")
    _forget()
    yield Scene("a scene", tmp_path / "a.ply")
    _forget()


def _forget() -> None:
    encode_cache.source_key.cache_clear()
    encode_cache.file_key.cache_clear()


def test_a_path_depends_on_everything_a_file_depends_on(scene: Scene, tmp_path: Path) -> None:
    """Scene, quality, effort, cameras and the encoder's source; not the command line."""
    (tmp_path / "cameras.json").write_text("[]")
    other = replace(scene, known=tmp_path / "cameras.json")
    ways = ((scene, 41.0, 2), (scene, 47.0, 2), (scene, 41.0, 1), (other, 41.0, 2))
    paths = {encode_cache.encoded_path(*way) for way in ways}
    assert len(paths) == 4
    before = encode_cache.encoded_path(scene, 41.0, 2)
    assert before in paths
    for changed, stale in (("scarfmt/cli/it.py", False), ("reference_encoder/it.py", True)):
        (tmp_path / changed).write_text("2")
        _forget()
        assert (encode_cache.encoded_path(scene, 41.0, 2) != before) == stale


def test_a_file_is_encoded_once_and_again_without_its_note(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    jobs: list[dict[str, Any]] = []

    def run(**job: Any) -> dict[str, Any]:
        jobs.append(job)
        Path(job["out"]).write_bytes(b"scar")
        child.note_path(Path(job["out"])).write_text(json.dumps({"seconds": len(jobs), "bytes": 4}))
        return {}

    monkeypatch.setattr(child, "run", run)
    first, second = (encode_cache.encode_scene(scene, 41.0, 2) for _ in range(2))
    assert first == second == {"path": jobs[0]["out"], "seconds": 1, "bytes": 4}
    child.note_path(Path(first["path"])).unlink()
    assert encode_cache.encode_scene(scene, 41.0, 2)["seconds"] == 2


def test_jobs_take_turns_in_processes_of_their_own() -> None:
    """Least and median over all rounds; variables of a job win over those of all; runs stop by number or by time."""
    jobs = {name: {"job": "tests.benchmarks.test_results:echo", "value": name} for name in ("one", "two")}
    found = child.run_in_turns({**jobs, "two": {**jobs["two"], "environment": {"OMP_NUM_THREADS": "8"}}}, 1)
    expected = {"value": "one", "threads": "1", "min": 3.0, "median": 4.0, "cpu": 1.0, "runs": 2, "peak_bytes": 0}
    assert found["one"] | {"peak_bytes": 0} == expected
    assert found["two"]["threads"] == "8"
    assert found["one"]["peak_bytes"] > 1 << 20
    assert [len(child.time_calls(lambda: None, 4, limit)["walls"]) for limit in (60.0, 0.0)] == [4, 1]


def echo(job: dict[str, Any]) -> dict[str, Any]:
    """The job that the test above gives to a child."""
    print("something a library prints")
    return {"value": job["value"], "threads": os.environ["OMP_NUM_THREADS"], "walls": [5.0, 3.0], "cpus": [1.0, 2.0]}


def past_run(date: str, modified: bool | None = False, **machine: Any) -> Run:
    return {"recorded": MEASURED, "date": date, "commit": "abc", "modified": modified, "machine": machine}


def test_a_run_covers_what_it_measured_and_the_rest_keeps_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    today = past_run("2030-01-02")
    monkeypatch.setattr(provenance, "describe_run", lambda: today)
    earlier = {FIELD: [{**past_run("2029-01-01"), "of": EVERYTHING}], "a": 1, "b": 2}
    found = stamp({"a": 1, "b": 3, "c": 4}, earlier, measured=["b", "c"])
    assert [(run["date"], run["of"]) for run in found[FIELD]] == [("2029-01-01", ["a"]), ("2030-01-02", ["b", "c"])]
    assert figures(found) == {"a": 1, "b": 3, "c": 4}
    assert stamp({"a": 1}, earlier)[FIELD] == [{**today, "of": EVERYTHING}]
    earlier = {FIELD: [{**past_run("2029-01-01"), "of": EVERYTHING}], "s": {"a": 1, "b": 2}}
    found = stamp({"s": {"a": 1, "b": 9}}, earlier, measured=["s/b"], depth=2)
    assert [run["of"] for run in found[FIELD]] == [["s/a"], ["s/b"]]
    same = group_runs({"a": today, "b": past_run("2029-01-01"), "c": today})
    assert [run["of"] for run in same] == [["b"], ["a", "c"]]


def test_a_statement_gives_dates_and_machines_of_the_figures_shown() -> None:
    runs = [
        {**past_run("2029-01-01", cpu="a chip", cores=2), "of": ["s/a", "t/a q47"]},
        {**past_run("2030-01-02", modified=True), "of": ["s/b"]},
    ]
    document = {FIELD: runs, "s": {"a": 1, "b": 2}, "t": {"a q47": 3}}
    assert statement(document, "t/") == statement(document, ending=" q47")
    assert statement(document, "t/") == "Measured 2029-01-01 on 2 cores of a chip."
    both = "Measured 2029-01-01 to 2030-01-02 on 2 cores of a chip and a machine not recorded."
    assert statement(document, "s/") == both
    with pytest.raises(ValueError, match="no run"):
        statement(document, "u/")


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_file_of_results_has_a_run_for_each_figure(path: Path) -> None:
    document = json.loads(path.read_text(encoding="utf-8"))
    covered = [name for run in document[FIELD] if run["of"] != EVERYTHING for name in run["of"]]
    names = figures(document)
    nested = [f"{section}/{name}" for section, below in names.items() if isinstance(below, dict) for name in below]
    assert sorted(covered) in (sorted(names), sorted(nested)) if covered else len(document[FIELD]) == 1


def test_pages_have_the_dates_of_their_figures() -> None:
    """Figures measured again without rewriting the page would fail here."""
    sections = [(quality.README, "results", "quality", "", quality.HEADLINE_NAMES)]
    sections += [(quality.EXAMPLES / "README.md", "example", "example", "", "")]
    sections += [(RESULTS_PAGE, name, name, "", "") for name in ("quality", "rivals", "trained")]
    for name in ("time", "scale"):
        sections += [(COSTS_PAGE, f"{name}-{part}", name, f"{part}/", "") for part in load_results(name)]
    for page, section, name, start, ending in sections:
        text = page.read_text(encoding="utf-8")
        shown = text.split(f"<!-- {section}:begin -->")[1].split(f"<!-- {section}:end -->")[0]
        assert statement(load_document(name), start, ending) in shown, f"{page.name}: {section}"


@pytest.mark.parametrize("effort", quality.EXAMPLE_EFFORTS)
def test_the_example_scene_is_as_small_and_as_good_as_recorded(effort: int) -> None:
    """From views the encoder was not given. `python -m benchmarks.quality --example` records what a change costs."""
    before, now = load_results(quality.EXAMPLE)[f"effort {effort}"], quality.measure_example(effort)
    for field in ("bytes", "first_layer_bytes"):
        assert now[field] <= MORE_BYTES * before[field], field
    for field in ("mean_psnr_db", "worst_psnr_db", "first_layer_psnr_db"):
        assert now[field] >= before[field] - LESS_DB, field
    # No record may leave these bounds: a record of a broken encoder would bound nothing.
    assert before["bytes"] < (quality.EXAMPLES / "plush-toys.ply").stat().st_size / 20
    assert before["mean_psnr_db"] > 39
    assert before["worst_psnr_db"] > 36
