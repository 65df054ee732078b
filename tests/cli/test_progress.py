"""Progress: only on a terminal, only for long work, never in the way."""

from __future__ import annotations

import io
import sys

import pytest

from scarfmt.cli import progress as module
from scarfmt.cli.progress import DELAY_SECONDS, progress


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time, as its only element."""
    now = [100.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    return now


def shown(monkeypatch: pytest.MonkeyPatch, clock: list[float], stream: io.StringIO, seconds: float, quiet: bool) -> str:
    monkeypatch.setattr(sys, "stderr", stream)
    with progress(quiet) as report:
        report("fit", 0.1)
        clock[0] += seconds
        report("code the tiles", 0.9)
    return stream.getvalue()


def test_long_work_on_a_terminal_shows_its_stage(monkeypatch: pytest.MonkeyPatch, clock: list[float]) -> None:
    assert "code the tiles" in shown(monkeypatch, clock, Terminal(), DELAY_SECONDS + 0.1, quiet=False)


@pytest.mark.parametrize(
    ("terminal", "seconds", "quiet"), [(True, 1.0, False), (False, 60.0, False), (True, 60.0, True)]
)
def test_else_nothing_is_printed(
    monkeypatch: pytest.MonkeyPatch, clock: list[float], terminal: bool, seconds: float, quiet: bool
) -> None:
    stream = Terminal() if terminal else io.StringIO()
    assert shown(monkeypatch, clock, stream, seconds, quiet) == ""


def test_without_rich_work_goes_on_in_silence(monkeypatch: pytest.MonkeyPatch, clock: list[float]) -> None:
    monkeypatch.setitem(sys.modules, "rich.console", None)
    assert shown(monkeypatch, clock, Terminal(), 60.0, quiet=False) == ""
