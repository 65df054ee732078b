"""The time that an out-of-core encoder will take, by what it has taken so far."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from scarfmt.coding.writer import Report

TELL_SECONDS = 30.0
"""Time between two lines about a step that goes on."""


@dataclass
class Estimate:
    """Progress through steps, each of so many like tasks.

    The rest of a step takes as long for each task as those that were done now. Steps that have not begun take what
    they take of the usual whole, in proportion to those that were done now.

    Attributes:
        shares: of each step in order, the part of the whole that it usually takes.
        report: told (what is done now, part of everything that is done).
        tell: told a line for people, now and then.
        clock: seconds.
    """

    shares: Mapping[str, float]
    report: Report
    tell: Callable[[str], None]
    clock: Callable[[], float] = time.monotonic
    _seconds: dict[str, float] = field(default_factory=dict)
    _step: str = ""
    _running: bool = False
    _begun: float = 0.0
    _told: float = 0.0

    def begin(self, step: str) -> None:
        """A step begins, or goes on with tasks of another kind; none before it takes any more time."""
        if step != self._step:
            if self._running:
                self._add(self._step)
            self._step, self._begun, self._told = step, self.clock(), self.clock()
        self._running = True
        self.report(step, self.part(step, 0.0, 0.0))

    def done(self, step: str, now: int, left: int) -> None:
        """Some tasks of a step have been done since it began, and some are left."""
        spent = self.clock() - self._begun
        rest = spent / now * left if now else 0.0
        self.report(self._said(step, now, left, rest), self.part(step, spent, rest))
        if self.clock() - self._told > TELL_SECONDS:
            self._told = self.clock()
            self.tell(self._said(step, now, left, rest))

    def end(self, step: str, now: int) -> None:
        """All tasks of a step, or all of a kind, have been done, `now` of them since it began."""
        self._running = False
        if now:
            spent = self._add(step)
            self.tell(f"{step}: {spent:.0f} s{_left(self.later(step))}")

    def _add(self, step: str) -> float:
        """Count the time since something began as time of a step; gives that time."""
        spent, self._begun = self.clock() - self._begun, self.clock()
        self._seconds[step] = self._seconds.get(step, 0.0) + spent
        return spent

    def later(self, step: str) -> float | None:
        """Seconds that the steps after one will take; None where nothing is known yet."""
        names = list(self.shares)
        usual = sum(self.shares[name] for name in self._seconds)
        if not usual:
            return None
        still = [name for name in names[names.index(step) + 1 :] if name not in self._seconds]
        return sum(self._seconds.values()) / usual * sum(self.shares[name] for name in still)

    def part(self, step: str, spent: float, rest: float) -> float:
        """Part of everything that is done."""
        later = self.later(step)
        names = list(self.shares)
        before = sum(self.shares[name] for name in names[: names.index(step)])
        if later is None or spent + rest + later <= 0:
            return before / sum(self.shares.values())
        past = sum(self._seconds.values())
        return (past + spent) / (past + spent + rest + later)

    def _said(self, step: str, now: int, left: int, rest: float) -> str:
        later = self.later(step)
        return f"{step}: {left} to do{_left(None if later is None or not now else rest + later)}"


def _left(seconds: float | None) -> str:
    if seconds is None:
        return ""
    if seconds < 100:
        return f", {seconds:.0f} s left"
    minutes = seconds / 60
    return f", {minutes:.0f} min left" if minutes < 100 else f", {minutes / 60:.1f} h left"
