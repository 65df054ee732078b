"""A decoder that answers many questions in one process, started again when it dies or has to be stopped."""

from __future__ import annotations

import contextlib
import re
import threading
import time
from dataclasses import replace
from pathlib import Path

from scarfmt_conformance.process import Child, Limits, memory_fault, status_text
from scarfmt_conformance.protocol import Answer, Capabilities, Fault, Question, Refusal, Reply, Values, parse

_GOODBYE_SECONDS = 0.5
_HIGH_WATER = re.compile(rb"^VmHWM:\s+(\d+) kB", re.MULTILINE)


class Session:
    """A decoder asked line by line.

    Args:
        words: its command, of :func:`scarfmt_conformance.protocol.command`.
        limits: time and output per question, memory of the process.
        stop: set to give up.

    Attributes:
        restarts: times it had to be started again.
    """

    def __init__(self, words: list[str], limits: Limits, stop: threading.Event):
        self._words, self._limits, self._stop = words, limits, stop
        self._child: Child | None = None
        self._starts = 0
        self._unheard: Fault | None = None

    @property
    def restarts(self) -> int:
        return max(self._starts - 1, 0)

    def ask(self, question: Question) -> Reply:
        """Ask it, starting it first where it does not run.

        A process that dies without having read the question died of the one before: another is asked then.

        Raises:
            Stopped: the run is being given up.
        """
        start = time.monotonic()
        before = self._settle()
        reply = self._asked(question, start)
        if reply is None:
            before = before or self._unheard
            reply = self._asked(question, start)
        if reply is None:
            fault = Fault("status", "ended without reading the question")
            reply = Reply(fault, time.monotonic() - start, None, "")
        return replace(reply, before=before)

    def _settle(self) -> Fault | None:
        """End a process that is over, or printed something after its answer, which must not answer the next question.

        Returns:
            What is to be said against it.
        """
        child = self._child
        if child is None:
            return None
        child.turn(0)
        fault = _status_after_answer(child) if child.ended() else None
        if child.take_output():
            fault = Fault("answer", "printed more than one line")
        if child.status is not None or fault is not None:
            self._end()
        return fault

    def _asked(self, question: Question, start: float) -> Reply | None:
        """The reply of the running process, or of a new one; None if it ended without having read the question."""
        if self._child is None:
            self._child = Child(self._words, self._limits, self._stop, asked_through=True)
            self._starts += 1
        child = self._child
        good = False
        try:
            answer = self._exchange(child, question, time.monotonic() + self._limits.seconds)
            good = isinstance(answer, Values | Refusal | Capabilities)
        finally:
            if not good:
                self._end()
        if answer is None:
            self._unheard = _status_after_answer(child)
            return None
        peak = _high_water(child) if good else child.peak_bytes
        return Reply(answer, time.monotonic() - start, peak, child.errors)

    def _exchange(self, child: Child, question: Question, deadline: float) -> Answer | Fault | None:
        sent = child.send(question.line())
        fault = child.wait(lambda: child.has_line, deadline)
        if fault is not None:
            return fault
        line, end, rest = child.take_output().partition(b"\n")
        if not end:
            if not sent or not child.has_read():
                return None
            return Fault("status", f"ended without an answer ({status_text(child.status or 0)})")
        fault = memory_fault(_high_water(child), self._limits)
        if fault is not None:
            return fault
        if rest:
            return Fault("answer", "printed more than one line")
        if child.ended() and child.status:
            return _status_after_answer(child)
        return parse(line) if sent else Fault("answer", "answered without reading the question")

    def _end(self) -> None:
        if self._child is not None:
            child, self._child = self._child, None
            child.close()

    def close(self) -> Fault | None:
        """End its input; kill it if it does not end of itself soon."""
        fault = self._settle()
        if self._child is not None and not self._stop.is_set():
            self._child.finish_input()
            self._child.wait(lambda: False, time.monotonic() + _GOODBYE_SECONDS)
        self._end()
        return fault


def _status_after_answer(child: Child) -> Fault | None:
    return Fault("status", f"{status_text(child.status)} after its answer") if child.status else None


def _high_water(child: Child) -> int | None:
    """Peak memory of a running process, bytes; None if the system does not report it."""
    if child.status is not None:
        return child.peak_bytes
    with contextlib.suppress(OSError):
        found = _HIGH_WATER.search(Path(f"/proc/{child.number}/status").read_bytes())
        return int(found[1]) << 10 if found else None
    return None
