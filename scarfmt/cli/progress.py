"""How far long work is, on stderr: on a terminal a line that is drawn again, elsewhere a line a minute."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

import click

DELAY_SECONDS = 2.0
"""Work that ends sooner shows nothing."""
LINE_SECONDS = 60.0
"""Between two lines where no terminal is."""
_FRAME_SECONDS = 0.1
_BAR = 24
_CLEAR = "\r\x1b[K"

Tell = Callable[[str, float], None]


@contextmanager
def progress(quiet: bool = False, steps: Mapping[str, float] | None = None) -> Iterator[Tell]:
    """A function to call with (what is done now, part of it that is done, 0..1).

    Args:
        steps: share of the time that each step takes, in order; what is told begins with the name of one. None where
            the part is one of the whole work.
    """
    if quiet or sys.stderr is None:
        yield lambda _now, _part: None
        return
    line = _Line(steps or {}, sys.stderr.isatty())
    try:
        yield line.tell
    finally:
        line.close()


class _Line:
    """The line, drawn anew as the work proceeds. Its part never goes back."""

    def __init__(self, steps: Mapping[str, float], terminal: bool) -> None:
        self._steps, self._terminal = steps, terminal
        self._first: tuple[float, float] | None = None
        self._part, self._step = 0.0, 0
        self._due = time.monotonic() + (DELAY_SECONDS if terminal else LINE_SECONDS)
        self._drawn = False

    def tell(self, now: str, part: float) -> None:
        """Draw the line if it is time."""
        names, clock = list(self._steps), time.monotonic()
        if now in names:
            self._step = max(self._step, names.index(now))
            before, total = sum(self._steps[name] for name in names[: names.index(now)]), sum(self._steps.values())
            part = (before + self._steps[now] * part) / total
        self._part = max(self._part, min(part, 1.0))
        self._first = self._first or (clock, self._part)
        if clock < self._due:
            return
        self._due = clock + (_FRAME_SECONDS if self._terminal else LINE_SECONDS)
        step = f"step {self._step + 1} of {len(names)}: " if names else ""
        words = f"{100 * self._part:3.0f} %  {step}{now}{self._left(clock)}"
        if self._terminal:
            full = round(_BAR * self._part)
            text = f"{'#' * full}{'-' * (_BAR - full)} {words}"
            click.echo(f"{_CLEAR}{text[: shutil.get_terminal_size().columns - 1]}", err=True, nl=False)
            self._drawn = True
        else:
            click.echo(f"scarfmt: {words.strip()}", err=True)

    def _left(self, clock: float) -> str:
        """The time left in words, as long for each part as since the first; nothing where that says little."""
        assert self._first is not None
        done = self._part - self._first[1]
        if done < 0.05 or self._part >= 1:
            return ""
        seconds = (clock - self._first[0]) / done * (1 - self._part)
        return f", {duration(seconds)} left"

    def close(self) -> None:
        """Remove the line from a terminal."""
        if self._drawn:
            click.echo(_CLEAR, err=True, nl=False)


def duration(seconds: float) -> str:
    """A time in words, such as ``40 s`` or ``3 min``."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = seconds / 60
    return f"{minutes:.0f} min" if minutes < 90 else f"{minutes / 60:.1f} h"
