"""One command for all benchmarks: which run, how, and what becomes of a failure."""

from __future__ import annotations

import re
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

import pytest

from benchmarks import all as every
from benchmarks import plots, report

REPOSITORY = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (every, plots, report):
        monkeypatch.setattr(module, "SHORT_RESULTS", tmp_path)


def test_the_others_run_when_one_fails_and_the_whole_fails(capsys: pytest.CaptureFixture[str]) -> None:
    ran = []

    def start(command: Sequence[str]) -> int:
        ran.append(command[2].removeprefix("benchmarks."))
        return 3 if ran[-1] == "positions" else 0

    assert every.main(["--short"], start) == 1
    assert ran == list(every.COMMANDS)
    rows = [line for line in capsys.readouterr().out.splitlines() if "failed" in line]
    assert len(rows) == 1
    assert rows[0].startswith("| positions |")
    assert "exit status 3" in rows[0]


def test_only_those_named_run_in_the_order_of_the_list() -> None:
    ran = []
    assert every.main(["--full", "--only", "gain", "quality"], lambda command: ran.append(list(command)) or 0) == 0
    assert [command[2] for command in ran] == ["benchmarks.quality", "benchmarks.gain"]


def test_the_short_mode_writes_nothing_into_the_repository() -> None:
    for short, full in every.COMMANDS.values():
        assert {"--short", "--no-write"} <= set(short)
        assert "--short" not in full


@pytest.mark.parametrize("name", every.COMMANDS)
def test_every_benchmark_is_there(name: str) -> None:
    assert find_spec(f"benchmarks.{name}") is not None


def test_make_runs_what_the_documents_say() -> None:
    makefile = (REPOSITORY / "Makefile").read_text(encoding="utf-8")
    found = dict(re.findall(r"^(bench(?:-full)?):.*\n\t(.*)$", makefile, re.MULTILINE))
    assert found["bench"].endswith("-m benchmarks.all --short")
    assert found["bench-full"].endswith("-m benchmarks.all --full")


def test_results_of_a_run_that_keeps_nothing_are_elsewhere(tmp_path: Path) -> None:
    report.save_results("a-test", {"x": 1}, keep=False)
    assert (tmp_path / "a-test.json").exists()
    assert not (report.RESULTS / "a-test.json").exists()


def _drawn(name: str, points: int = 3) -> Path:
    figure, axes = plots.new_plot("x", "y", log_x=True)
    plots.line(axes, list(range(1, points + 1)), list(range(points)), "a line", 0)
    return plots.save_plot(figure, name, keep=False)


def test_a_plot_drawn_again_is_the_same_file() -> None:
    """Else every run would change the repository."""
    assert _drawn("one").read_bytes() == _drawn("two").read_bytes()


def test_a_plot_too_large_for_the_repository_is_refused() -> None:
    with pytest.raises(ValueError, match="at most"):
        _drawn("large", 2000)
