"""Processor time and peak memory of the processes that a process starts, whoever starts and ends them (Linux)."""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path
from typing import Self

SECONDS = 0.5
"""Between two looks."""
_PROCESSES = Path("/proc")


class Watch:
    """Looks at all descendants of this process while it is entered.

    Attributes:
        peak_bytes: most memory that any one of them held at once; 0 where there is none, or no Linux.
    """

    def __init__(self) -> None:
        self.peak_bytes = 0
        self._cpu: dict[int, float] = {}
        self._ended = threading.Event()
        self._own = 0.0
        self._thread = threading.Thread(target=self._look_on, daemon=True)

    def __enter__(self) -> Self:
        self._own = time.process_time()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        self._own = time.process_time() - self._own

    @property
    def cpu_seconds(self) -> float:
        """Processor time of this process and of its descendants, up to the last look at each."""
        return self._own + sum(self._cpu.values())

    def _look_on(self) -> None:
        while not self._ended.wait(SECONDS):
            self.look()

    def look(self) -> None:
        """Look once."""
        parents, times = _table()
        for process in parents:
            if _descends(process, os.getpid(), parents):
                self._cpu[process] = times[process]
                self.peak_bytes = max(self.peak_bytes, _peak(process))


def _table() -> tuple[dict[int, int], dict[int, float]]:
    """The parent of each process, and its processor time, seconds."""
    parents, times = {}, {}
    tick = os.sysconf("SC_CLK_TCK") if hasattr(os, "sysconf") else 100
    for path in _PROCESSES.glob("[0-9]*/stat"):
        try:
            # The name, in brackets, may hold anything.
            fields = path.read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()
        except OSError:
            continue
        process = int(path.parent.name)
        parents[process], times[process] = int(fields[1]), (int(fields[11]) + int(fields[12])) / tick
    return parents, times


def _descends(process: int, ancestor: int, parents: dict[int, int]) -> bool:
    while process in parents:
        process = parents[process]
        if process == ancestor:
            return True
    return False


def _peak(process: int) -> int:
    try:
        status = (_PROCESSES / str(process) / "status").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return 0
    _, found, rest = status.partition("VmHWM:")
    return int(rest.split()[0]) * 1024 if found else 0
