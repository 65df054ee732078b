"""Running a decoder that is not trusted: bounded in time, memory and output, and ended with all it started.

The memory limit is RLIMIT_DATA, not RLIMIT_AS: engines such as V8 reserve gigabytes of addresses that they never
touch, which the first does not count, while anything allocated to be written to is counted by both.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import resource
import selectors
import signal
import struct
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import IO

from scarfmt_conformance.protocol import Answer, Fault, Question, Reply, filled, parse, printable

OUTPUT_BYTES = 256 << 20
_ERROR_BYTES = 8 << 10
_CHUNK = 1 << 16
_TURN_SECONDS = 0.05
_EXIT_SECONDS = 0.002
_RSS_UNIT = 1 if sys.platform == "darwin" else 1024

# A limit above the one already in force cannot be set; then that one holds. The child's number stays that of the shell.
_LIMITED = 'ulimit -c 0 2>/dev/null; ulimit -d "$0" 2>/dev/null; exec "$@"'


@dataclass(frozen=True)
class Limits:
    """The limits of a decoder for a question.

    Attributes:
        seconds: time.
        memory_bytes: data of each of its processes.
        output_bytes: on standard output.
    """

    seconds: float = 60.0
    memory_bytes: int = 2048 << 20
    output_bytes: int = OUTPUT_BYTES


class Stopped(Exception):
    """The run is being given up."""


class Child:
    """A process in a group of its own, its outputs read as they come so that it never waits for its reader.

    Args:
        words: the command; the program exists.
        limits: memory and output are enforced here, time by who waits.
        stop: set when the run is given up.
        asked_through: whether it has a standard input to be asked through; else that is empty.

    Attributes:
        has_line: it has printed a line end since :meth:`take_output`.
        status: exit status, minus the number of the signal that killed it; None while it runs.
        peak_bytes: most memory it held, with its children; None while it runs, and where that is not known.
    """

    def __init__(self, words: list[str], limits: Limits, stop: threading.Event, asked_through: bool = False):
        self.has_line = False
        self.status: int | None = None
        self.peak_bytes: int | None = None
        self._output, self._errors = bytearray(), bytearray()
        self._limits, self._stop = limits, stop
        self._process = subprocess.Popen(
            ["/bin/sh", "-c", _LIMITED, str(limits.memory_bytes >> 10), *words],
            stdin=subprocess.PIPE if asked_through else subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )
        self._streams = selectors.DefaultSelector()
        for stream, take in ((self._process.stdout, self._take_output), (self._process.stderr, self._take_errors)):
            assert stream is not None
            os.set_blocking(stream.fileno(), False)
            self._streams.register(stream, selectors.EVENT_READ, take)

    @property
    def errors(self) -> str:
        """End of what it wrote to standard error, printable."""
        return printable(self._errors.decode("utf-8", "replace"), _ERROR_BYTES, lines=True).strip()

    @property
    def number(self) -> int:
        """The id of its process."""
        return self._process.pid

    def take_output(self) -> bytes:
        """The output since the last call."""
        data = bytes(self._output)
        self._output.clear()
        self.has_line = False
        return data

    def send(self, data: bytes) -> bool:
        """Write to its standard input; False if it does not take that."""
        assert self._process.stdin is not None
        descriptor = self._process.stdin.fileno()
        os.set_blocking(descriptor, False)
        try:
            return os.write(descriptor, data) == len(data)
        except OSError:
            return False

    def has_read(self) -> bool:
        """Whether it has read all that was sent; True if the system does not report it."""
        assert self._process.stdin is not None
        try:
            left = fcntl.ioctl(self._process.stdin.fileno(), termios.FIONREAD, bytes(4))
        except OSError:
            return True
        return not struct.unpack("i", left)[0]

    def finish_input(self) -> None:
        """Let it see the end of its input."""
        assert self._process.stdin is not None
        self._process.stdin.close()

    def wait(self, enough: Callable[[], bool], deadline: float) -> Fault | None:
        """Read until `enough`, the end of the process, or a limit.

        Raises:
            Stopped: the run is being given up.
        """
        while not enough():
            if self._stop.is_set():
                raise Stopped
            if len(self._output) > self._limits.output_bytes:
                return Fault("output", f"printed more than {self._limits.output_bytes:,} bytes")
            if self.ended():
                self._drain()
                return None
            left = deadline - time.monotonic()
            if left <= 0:
                return Fault("timeout", f"no answer within {self._limits.seconds:g} s")
            self.turn(min(left, _TURN_SECONDS))
        return None

    def turn(self, seconds: float) -> bool:
        """Read what has come, or comes within `seconds`; whether anything did."""
        if not self._streams.get_map():
            time.sleep(min(seconds, _EXIT_SECONDS))
            return False
        came = False
        for key, _ in self._streams.select(seconds):
            came |= self._read(key)
        return came

    def _read(self, key: selectors.SelectorKey) -> bool:
        try:
            data = os.read(key.fd, _CHUNK)
        except BlockingIOError:
            return False
        if data:
            key.data(data)
        else:
            self._streams.unregister(key.fileobj)
        return bool(data)

    def _take_output(self, data: bytes) -> None:
        self._output += data
        self.has_line = self.has_line or b"\n" in data

    def _take_errors(self, data: bytes) -> None:
        self._errors = (self._errors + data)[-_ERROR_BYTES:]

    def ended(self) -> bool:
        """Whether the process is over; if so, its status and peak memory are known, and what it started is killed."""
        if self.status is None:
            number, status, usage = os.wait4(self._process.pid, os.WNOHANG)
            if number:
                self._reaped(status, usage)
        return self.status is not None

    def _reaped(self, status: int, usage: resource.struct_rusage) -> None:
        self.status = self._process.returncode = os.waitstatus_to_exitcode(status)
        self.peak_bytes = _peak(usage)
        self._kill_group()

    def _kill_group(self) -> None:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)

    def _drain(self) -> None:
        # What an ended process wrote is in the pipe. A process that left its group may keep the pipe open and go on
        # writing: no more than a pipe holds is waited for.
        for _ in range(64):
            if not self.turn(0):
                return

    def close(self) -> None:
        """Kill it and everything in its group, if it is not over."""
        if self.status is None:
            self._kill_group()
            _, status, usage = os.wait4(self._process.pid, 0)
            self._reaped(status, usage)
        self._streams.close()
        streams: tuple[IO[bytes] | None, ...] = (self._process.stdin, self._process.stdout, self._process.stderr)
        for stream in streams:
            if stream is not None:
                stream.close()


def status_text(status: int) -> str:
    """An exit status as people know it."""
    if status >= 0:
        return f"exit status {status}"
    try:
        return f"killed by {signal.Signals(-status).name}"
    except ValueError:
        return f"killed by signal {-status}"


def memory_fault(peak_bytes: int | None, limits: Limits) -> Fault | None:
    """A fault if a process held more memory than it may; RLIMIT_DATA leaves out shared and file-backed pages."""
    if peak_bytes is None or peak_bytes <= limits.memory_bytes:
        return None
    return Fault("memory", f"held {peak_bytes >> 20:,} MiB, {limits.memory_bytes >> 20:,} MiB are allowed")


def _peak(usage: resource.struct_rusage) -> int | None:
    """Peak memory of a child, in bytes; None if it is not above our own.

    Between fork and exec a child has the pages of this process, and they count.
    """
    own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return usage.ru_maxrss * _RSS_UNIT if usage.ru_maxrss > own else None


class OneShot:
    """A decoder that is run anew for each question.

    Args:
        words: its command, of :func:`scarfmt_conformance.protocol.template`.
        limits: per question.
        stop: set to give up.
    """

    restarts = 0
    """Number of restarts: always 0, because every question starts a process."""

    def __init__(self, words: list[str], limits: Limits, stop: threading.Event):
        self._words, self._limits, self._stop = words, limits, stop

    def ask(self, question: Question) -> Reply:
        """Run it.

        Raises:
            Stopped: the run is being given up.
        """
        start = time.monotonic()
        child = Child(filled(self._words, question), self._limits, self._stop)
        try:
            fault = child.wait(lambda: False, start + self._limits.seconds)
            answer = fault or self._answer(child)
        finally:
            child.close()
        return Reply(answer, time.monotonic() - start, child.peak_bytes, child.errors)

    def _answer(self, child: Child) -> Answer | Fault:
        fault = memory_fault(child.peak_bytes, self._limits)
        if fault is None and child.status:
            fault = Fault("status", status_text(child.status))
        return fault or parse(child.take_output())

    def close(self) -> Fault | None:
        """Nothing runs between questions."""
        return None
