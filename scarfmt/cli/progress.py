"""A progress bar on stderr, on terminals only. Work that ends within two seconds shows none."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

DELAY_SECONDS = 2.0

Report = Callable[[str, float], None]


@contextmanager
def progress(quiet: bool = False) -> Iterator[Report]:
    """A function to call with (name of the stage, part of it that is done, 0..1)."""
    if quiet or sys.stderr is None or not sys.stderr.isatty():
        yield lambda _stage, _part: None
        return
    bar = _LateBar()
    try:
        yield bar.report
    finally:
        bar.close()


class _LateBar:
    """A progress bar that appears after `DELAY_SECONDS`."""

    def __init__(self) -> None:
        self._start = time.monotonic()
        self._shown: tuple[Progress, TaskID] | None = None

    def report(self, stage: str, part: float) -> None:
        if self._shown is None and time.monotonic() - self._start > DELAY_SECONDS:
            self._shown = _open_bar()
        if self._shown is not None:
            bar, task = self._shown
            bar.update(task, description=stage, completed=part)

    def close(self) -> None:
        if self._shown is not None:
            self._shown[0].stop()


def _open_bar() -> tuple[Progress, TaskID] | None:
    try:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
    except ImportError:
        return None
    columns = (TextColumn("{task.description:<24}"), BarColumn(), TimeElapsedColumn())
    bar = Progress(*columns, console=Console(stderr=True), transient=True)
    bar.start()
    return bar, bar.add_task("", total=1.0)
