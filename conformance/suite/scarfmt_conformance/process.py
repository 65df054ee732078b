"""Running a decoder that is not trusted: bounded in time, memory and output, and ended with all it started.

The memory limit is RLIMIT_DATA, not RLIMIT_AS: engines such as V8 reserve gigabytes of addresses that they never
touch, which the first does not count, while anything allocated to be written to is counted by both.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import subprocess
import tempfile
import time
from dataclasses import dataclass
from typing import IO

from scarfmt_conformance.protocol import Answer, Fault, Question, Reply, fill, parse, printable

OUTPUT_BYTES = 256 << 20
_ERROR_BYTES = 8 << 10
_CHUNK = 1 << 16
_TURN_SECONDS = 0.02
_GOODBYE_SECONDS = 0.5

# Cores, data and the size of files, standard error among them. A limit above the one in force cannot be set.
_LIMITED = 'ulimit -c 0 2>/dev/null; ulimit -d "$0" 2>/dev/null; ulimit -f 2097152 2>/dev/null; exec "$@"'


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


class Program:
    """A decoder's command: run anew for each question, or as a session started once and asked line by line.

    Args:
        words: the command, which exists; with places to fill, unless it is a session.
        limits: per question.
        session: whether one process answers many questions. It is started again when it died or had to be stopped.
    """

    def __init__(self, words: list[str], limits: Limits, session: bool = False) -> None:
        self._words, self._limits, self._session = words, limits, session
        self._process: subprocess.Popen[bytes] | None = None
        self._errors: IO[bytes] | None = None
        self._killed = False

    def ask(self, question: Question) -> Reply:
        """The answer to a question, or a fault; raises nothing because of the decoder."""
        start = time.monotonic()
        answer: Answer | Fault = Fault("status", "the run is given up")
        errors = ""
        if not self._killed:
            if self._process is not None and self._process.poll() == 0:
                self._end()
            late = None if self._process is None else self._after_an_answer(self._process)
            process = self._process or self._start(self._words if self._session else fill(self._words, question))
            answer = late or self._ask(process, question, start + self._limits.seconds)
            errors = self._last_errors()
            if not self._session or isinstance(answer, Fault) or process.poll() is not None:
                self._end()
        return Reply(answer, time.monotonic() - start, errors)

    def _start(self, words: list[str]) -> subprocess.Popen[bytes]:
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115  (closed with the process)
        self._process = subprocess.Popen(
            ["/bin/sh", "-c", _LIMITED, str(self._limits.memory_bytes >> 10), *words],
            stdin=subprocess.PIPE if self._session else subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            start_new_session=True,
        )
        return self._process

    def _after_an_answer(self, process: subprocess.Popen[bytes]) -> Fault | None:
        """What a session did unasked: a line more would be taken for the answer to the next question."""
        if process.poll():
            return Fault("status", f"{status_text(process.returncode)} after the answer before")
        assert process.stdout is not None
        if select.select([process.stdout], [], [], 0)[0] and os.read(process.stdout.fileno(), _CHUNK):
            return Fault("answer", "printed more than one line to the question before")
        return None

    def _ask(self, process: subprocess.Popen[bytes], question: Question, deadline: float) -> Answer | Fault:
        if process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                os.write(process.stdin.fileno(), question.line())
        output = self._read(process, deadline)
        if isinstance(output, Fault):
            return output
        line, end, rest = output.partition(b"\n")
        if self._session and end:
            return Fault("answer", "printed more than one line") if rest else parse(line)
        if self._session:
            return Fault("status", f"ended without an answer ({status_text(process.returncode)})")
        return Fault("status", status_text(process.returncode)) if process.returncode else parse(output)

    def _read(self, process: subprocess.Popen[bytes], deadline: float) -> bytes | Fault:
        """The output to the end of the process, or of a session to the end of a line."""
        assert process.stdout is not None
        output = bytearray()
        while True:
            left = deadline - time.monotonic()
            if left <= 0:
                return Fault("timeout", f"no answer within {self._limits.seconds:g} s")
            # What it started may hold the output open: what an ended process wrote is in the pipe.
            over = process.poll() is not None
            if not select.select([process.stdout], [], [], 0 if over else min(left, _TURN_SECONDS))[0]:
                if over:
                    return bytes(output)
                continue
            data = os.read(process.stdout.fileno(), _CHUNK)
            output += data
            if len(output) > self._limits.output_bytes:
                return Fault("output", f"printed more than {self._limits.output_bytes:,} bytes")
            if self._session and b"\n" in data:
                return bytes(output)
            if not data:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(left)
                    return bytes(output)

    def _last_errors(self) -> str:
        """End of what it wrote to standard error, printable."""
        assert self._errors is not None
        self._errors.seek(max(0, self._errors.seek(0, os.SEEK_END) - _ERROR_BYTES))
        return printable(self._errors.read().decode("utf-8", "replace"), _ERROR_BYTES, lines=True).strip()

    def _end(self) -> None:
        """Kill the process and everything in its group."""
        process, self._process = self._process, None
        if process is None:
            return
        _kill_group(process)
        process.wait()
        for stream in (process.stdin, process.stdout, self._errors):
            if stream is not None:
                stream.close()

    def close(self) -> None:
        """Let a session see the end of its input, and end it if it stays."""
        if self._process is not None and self._process.stdin is not None:
            self._process.stdin.close()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(_GOODBYE_SECONDS)
        self._end()

    def kill(self) -> None:
        """End the process from another thread, and start no other: the run is given up."""
        self._killed = True
        if self._process is not None:
            _kill_group(self._process)


def _kill_group(process: subprocess.Popen[bytes]) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)


def status_text(status: int) -> str:
    """An exit status as people know it."""
    if status >= 0:
        return f"exit status {status}"
    try:
        return f"killed by {signal.Signals(-status).name}"
    except ValueError:
        return f"killed by signal {-status}"
