"""Provenance of results: what a run says of itself, which figures it covers, and what pages say of that."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

from benchmarks import provenance, report
from benchmarks.provenance import EVERYTHING, FIELD, FROM_HISTORY, MEASURED, Run, figures, grouped, stamped, statement
from tests.conftest import REPOSITORY

FILES = sorted(path for folder in ("benchmarks", "fuzz") for path in (REPOSITORY / folder / "results").glob("*.json"))
MACHINE = {"cpu", "cores", "os", "python", "numpy", "torch", "numba", "kernel"}


def _run(date: str, recorded: str = MEASURED, modified: bool | None = False, **machine: Any) -> Run:
    return {"recorded": recorded, "date": date, "commit": "abc", "modified": modified, "machine": machine}


@pytest.fixture
def today(monkeypatch: pytest.MonkeyPatch) -> Run:
    """The provenance of a run of now, whenever the test runs."""
    run = _run("2030-01-02", cpu="a chip", cores=2)
    monkeypatch.setattr(provenance, "now", lambda: run)
    return run


def test_a_run_says_when_which_commit_and_on_what() -> None:
    found = provenance.now()
    if (REPOSITORY / ".git").exists():
        head = subprocess.run(["git", "rev-parse", "HEAD"], cwd=REPOSITORY, capture_output=True, text=True, check=True)
        assert head.stdout.startswith(found["commit"])
        assert len(found["commit"]) == 12
    assert found["date"] >= "2026-11-22"
    assert set(found["machine"]) == MACHINE
    assert found["machine"]["kernel"] in ("on", "off")


def test_a_run_covers_what_it_measured_and_the_rest_keeps_its_own(today: Run) -> None:
    earlier = {FIELD: [{**_run("2029-01-01"), "of": EVERYTHING}], "a": 1, "b": 2}
    found = stamped({"a": 1, "b": 3, "c": 4}, earlier, measured=["b", "c"])
    assert [(run["date"], run["of"]) for run in found[FIELD]] == [("2029-01-01", ["a"]), ("2030-01-02", ["b", "c"])]
    assert figures(found) == {"a": 1, "b": 3, "c": 4}


def test_figures_measured_again_are_of_now_even_where_they_are_the_same(today: Run) -> None:
    earlier = {FIELD: [{**_run("2029-01-01"), "of": EVERYTHING}], "a": 1}
    assert stamped({"a": 1}, earlier)[FIELD] == [{**today, "of": EVERYTHING}]


def test_names_in_sections_have_runs_of_their_own(today: Run) -> None:
    earlier = {FIELD: [{**_run("2029-01-01"), "of": EVERYTHING}], "s": {"a": 1, "b": 2}}
    found = stamped({"s": {"a": 1, "b": 9}}, earlier, measured=["s/b"], depth=2)
    assert [run["of"] for run in found[FIELD]] == [["s/a"], ["s/b"]]


def test_runs_that_say_the_same_are_one() -> None:
    found = grouped({"a": _run("2030-01-02"), "b": _run("2029-01-01"), "c": _run("2030-01-02")})
    assert [run["of"] for run in found] == [["b"], ["a", "c"]]


def test_a_statement_names_date_commit_and_machine() -> None:
    run = _run("2030-01-02", modified=True, cpu="a chip", cores=2, os="an OS", python="3.11", torch=None, kernel="on")
    assert statement({FIELD: [{**run, "of": EVERYTHING}], "a": 1}) == (
        "Measured on 2030-01-02 at commit `abc`, with changes, on 2 cores of a chip, an OS, Python 3.11, kernel on."
    )


def test_a_statement_admits_what_is_only_known_from_history() -> None:
    text = statement({FIELD: [{**_run("2030-01-02", FROM_HISTORY, None), "of": EVERYTHING}], "a": 1})
    assert text.startswith("Recorded on 2030-01-02 with commit `abc` (read from the history of the file)")
    assert "machine not recorded" in text


def test_a_statement_of_a_section_leaves_out_the_runs_of_others() -> None:
    runs = [{**_run("2029-01-01"), "of": ["s/a", "t/a"]}, {**_run("2030-01-02"), "of": ["s/b"]}]
    document = {FIELD: runs, "s": {"a": 1, "b": 2}, "t": {"a": 3}}
    assert "2030" not in statement(document, "t/")
    assert [line.split(":")[0] for line in statement(document, "s/").splitlines()] == ["- a", "- b"]


def test_a_statement_of_an_ending_is_that_of_the_names_shown() -> None:
    """One run is left, so its names are not listed: those of a headline table are in the table."""
    document = {FIELD: [{**_run("2029-01-01"), "of": ["a q47", "b q47"]}, {**_run("2030-01-02"), "of": ["a q41"]}]}
    assert statement(document, ending=" q47").startswith("Measured on 2029-01-01 at")


def test_figures_of_which_no_run_is_known_cannot_be_shown() -> None:
    with pytest.raises(ValueError, match="no run"):
        statement({"a": 1})
    with pytest.raises(ValueError, match="no run"):
        statement({FIELD: [{**_run("2029-01-01"), "of": ["s/a"]}], "s": {"a": 1}}, "t/")


def test_results_are_kept_in_the_order_they_were_given(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Tables take their rows and columns from it."""
    monkeypatch.setattr(report, "RESULTS", tmp_path)
    report.save_results("a-test", {"second": {"z": 1, "a": 2}, "first": {}})
    assert list(report.load_results("a-test")) == ["second", "first"]
    assert list(report.load_results("a-test")["second"]) == ["z", "a"]


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_file_of_results_says_of_all_its_figures_where_they_are_from(path: Path) -> None:
    document = json.loads(path.read_text(encoding="utf-8"))
    assert document[FIELD]
    covered: list[str] = []
    for run in document[FIELD]:
        assert run["recorded"] in (MEASURED, FROM_HISTORY)
        assert len(run["date"]) == 10
        assert run["recorded"] == FROM_HISTORY or set(run["machine"]) == MACHINE
        covered += [] if run["of"] == EVERYTHING else run["of"]
    if covered:
        names = figures(document)
        nested = [f"{section}/{name}" for section, below in names.items() if isinstance(below, dict) for name in below]
        assert sorted(covered) in (sorted(names), sorted(nested))
    else:
        assert len(document[FIELD]) == 1
