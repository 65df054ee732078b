"""Progress: only for long work, never backwards, a line a minute where no terminal is."""

from __future__ import annotations

import io
import re
import sys

import pytest

from scarfmt.cli import progress as module
from scarfmt.cli.progress import DELAY_SECONDS, LINE_SECONDS, progress

STEPS = {"read": 1.0, "fit": 2.0, "write": 1.0}


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time, as its only element."""
    now = [100.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    return now


def shown(
    monkeypatch: pytest.MonkeyPatch,
    clock: list[float],
    stream: io.StringIO,
    told: list[tuple[float, str, float]],
    quiet: bool = False,
) -> str:
    """What is printed where so many seconds pass before each report."""
    monkeypatch.setattr(sys, "stderr", stream)
    with progress(quiet, STEPS) as tell:
        for seconds, step, part in told:
            clock[0] += seconds
            tell(step, part)
    return stream.getvalue()


def test_a_terminal_shows_step_part_and_time_left(monkeypatch: pytest.MonkeyPatch, clock: list[float]) -> None:
    """A quarter of the work took 10 seconds, so three quarters take 30. The line is removed at the end."""
    text = shown(monkeypatch, clock, Terminal(), [(0, "read", 0), (10, "fit", 0)])
    assert " 25 %  step 2 of 3: fit, 30 s left" in text
    assert text.endswith("\r\x1b[K")


def test_the_part_never_goes_back(monkeypatch: pytest.MonkeyPatch, clock: list[float]) -> None:
    """Steps may be told again and again, and end early."""
    told = [("read", 1.0), ("fit", 0.8), ("fit", 0.1), ("write", 0.0), ("fit", 0.9), ("write", 1.0)]
    text = shown(monkeypatch, clock, Terminal(), [(DELAY_SECONDS + 1, *each) for each in told])
    parts = [int(part) for part in re.findall(r"(\d+) %", text)]
    assert parts == [25, 65, 65, 75, 75, 100]


def test_elsewhere_a_minute_gives_one_line(monkeypatch: pytest.MonkeyPatch, clock: list[float]) -> None:
    told = [(1.0, "fit", number / 300) for number in range(300)]
    lines = shown(monkeypatch, clock, io.StringIO(), told).splitlines()
    assert len(lines) == 300 // LINE_SECONDS
    assert all(line.startswith("scarfmt: ") for line in lines)


@pytest.mark.parametrize(("stream", "seconds", "quiet"), [(Terminal(), 1.0, False), (Terminal(), 600.0, True)])
def test_short_or_quiet_work_shows_nothing(
    monkeypatch: pytest.MonkeyPatch, clock: list[float], stream: io.StringIO, seconds: float, quiet: bool
) -> None:
    assert shown(monkeypatch, clock, stream, [(0, "read", 0), (seconds, "fit", 0)], quiet) == ""
