"""Results: provenance covers every figure of every page, and the example scene is what it was."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks import provenance, quality
from benchmarks.provenance import EVERYTHING, FIELD, MEASURED, Run, figures, group_runs, stamp, statement
from benchmarks.report import COSTS_PAGE, RESULTS_PAGE, load_document, load_results
from benchmarks.scenes import REPOSITORY

FILES = sorted((REPOSITORY / "benchmarks" / "results").glob("*.json"))
MORE_BYTES, LESS_DB = 1.10, 0.5


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
