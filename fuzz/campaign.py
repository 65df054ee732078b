"""Inputs of one kind through the code, under limits of memory and time: ``python -m fuzz.campaign --kind mutants``.

Kinds:
    mutants: damaged files through decode, validate, dump and truncate.
    deep: sound files that say something else, all checksums right: most reach the decoder of symbols.
    bit-flips: single bits of sound files, each of which must be noticed.
    importers: damaged scene files of other formats (:mod:`fuzz.importers`).

A finding is any exception but a ScarError, a death of the process, more than 5 s of the processor or 512 MiB, or what
the kind itself finds wrong. Findings go to ``fuzz/findings/``, counts of outcomes are printed as JSON. Input n of a
kind and seed S is always the same; ``--first`` goes on after an earlier run. With ``--compare``, files are decoded in
NumPy alone, too, and another answer than the C library's is a finding.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import resource
import signal
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from multiprocessing.connection import Connection, wait
from pathlib import Path
from types import FrameType
from typing import Any

from fuzz import importers, inputs
from fuzz.case import Case

SECONDS = 5.0
"""Maximum processor time of an input, seconds. Other programs on a machine do not count."""
MEMORY = 512 << 20
"""Of an input."""
HUNG = 60.0
"""A process that is stuck below Python, where no alarm reaches it, is killed after so long."""
FINDINGS = Path(__file__).with_name("findings")
KINDS: dict[str, Callable[[int, bool], Callable[[int], Case]]] = {
    **{kind: partial(inputs.prepare, kind) for kind in inputs.KINDS},
    "importers": lambda seed, _: importers.prepare(seed),
}
"""By kind, what makes input n, given the seed and whether engines are compared."""
_BATCH = 50
_KEPT = 10
_SHOW_EVERY = 30.0


class Hang(BaseException):
    """An input took more processor time than it may."""


@dataclass
class Tally:
    """The totals of a batch: how many inputs of each outcome, the slowest, and what is wrong."""

    outcomes: Counter[str] = field(default_factory=Counter)
    slowest: list[tuple[float, str]] = field(default_factory=list)
    findings: list[dict[str, str]] = field(default_factory=list)

    def add(self, other: Tally) -> None:
        """Take another batch in."""
        self.outcomes += other.outcomes
        self.slowest = sorted(self.slowest + other.slowest, reverse=True)[:_KEPT]
        self.findings += other.findings

    def enter(self, case: Case, what: str, folder: Path) -> None:
        """Enter a finding, and keep the bytes."""
        self.findings.append({"input": case.name, "what": what})
        folder.mkdir(exist_ok=True)
        (folder / case.name.split()[0]).write_bytes(case.data)


def on_alarm(_signal: int, _frame: FrameType | None) -> None:
    """End the input that the processor time ran out for."""
    raise Hang


@dataclass(frozen=True)
class Examiner:
    """Takes inputs through the code, one by one.

    Attributes:
        make: input n.
        seconds: of the processor for one, where `on_alarm` is installed.
        memory: bytes for one, in a process of its own; 0 for no limit.
        findings: folder for their bytes.
    """

    make: Callable[[int], Case]
    seconds: float = SECONDS
    memory: int = MEMORY
    findings: Path = FINDINGS

    def run(self, numbers: range, begin: Callable[[int], object] = bool) -> Tally:
        """All inputs of a batch; `begin` is called with the number of each."""
        tally = Tally()
        for number in numbers:
            begin(number)
            case = self.make(number)
            start = time.process_time()
            outcome, finding = self._examine(case)
            tally.slowest.append((round(time.process_time() - start, 4), case.name))
            tally.outcomes[outcome] += 1
            if finding is not None:
                tally.enter(case, finding, self.findings)
        return tally

    def _examine(self, case: Case) -> tuple[str, str | None]:
        signal.setitimer(signal.ITIMER_PROF, self.seconds)
        try:
            return case.act()
        except Hang:
            return "hang", traceback.format_exc(limit=-4)
        except Exception as error:
            return type(error).__name__, traceback.format_exc(limit=-6)
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)


class _Job:
    """A process at work on a batch; it may die of one of its inputs."""

    def __init__(self, examiner: Examiner, numbers: range) -> None:
        context = multiprocessing.get_context("fork")
        self.numbers = numbers
        self.receiver, sender = context.Pipe(duplex=False)
        self._number = context.Value("q", -1, lock=False)
        self._seen = (-1, time.monotonic())
        self._process = context.Process(target=self._work, args=(examiner, sender), daemon=True)
        self._process.start()
        sender.close()

    def _work(self, examiner: Examiner, sender: Connection) -> None:
        signal.signal(signal.SIGPROF, on_alarm)
        if examiner.memory:
            size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
            # Beside the input's own: garbage not yet collected, and the allocator's pools.
            limit = size + examiner.memory + (256 << 20)
            resource.setrlimit(resource.RLIMIT_AS, (limit, limit))

        def begin(number: int) -> None:
            self._number.value = number

        sender.send(examiner.run(self.numbers, begin))

    @property
    def stuck(self) -> bool:
        """Whether it has been at the same input for too long."""
        if self._number.value != self._seen[0]:
            self._seen = (self._number.value, time.monotonic())
        return time.monotonic() - self._seen[1] > HUNG

    def end(self) -> tuple[int, str]:
        """Kill it; the number of the input it was at, and how it ended."""
        stuck = self.stuck
        self._process.join(1)
        self._process.kill()
        self._process.join()
        if not stuck and self._process.exitcode == 1:
            raise RuntimeError(f"the campaign itself failed at input {self._number.value}")
        return self._number.value, "stuck" if stuck else f"died, exit code {self._process.exitcode}"


def run_campaign(examiner: Examiner, numbers: range, jobs: int, until: float) -> Tally:
    """All inputs, in so many processes; no work is given out after `until`, by `time.monotonic`."""
    todo = (numbers[start : start + _BATCH] for start in range(0, len(numbers), _BATCH))
    rest: list[range] = []
    running: list[_Job] = []
    tally = Tally()
    start = shown = time.monotonic()
    while True:
        while len(running) < jobs:
            batch = rest.pop() if rest else next(todo, None) if time.monotonic() < until else None
            if batch is None:
                break
            running.append(_Job(examiner, batch))
        if not running:
            return tally
        ready: Sequence[Any] = wait([job.receiver for job in running], 1.0)
        for job in [job for job in running if job.receiver in ready or job.stuck]:
            running.remove(job)
            try:
                if job.receiver not in ready:
                    raise EOFError
                tally.add(job.receiver.recv())
            except EOFError:
                number, what = job.end()
                tally.enter(examiner.make(number), f"{what}; its batch is not counted up to it", examiner.findings)
                if number + 1 in job.numbers:
                    rest.append(range(number + 1, job.numbers.stop))
        if time.monotonic() - shown > _SHOW_EVERY:
            shown = time.monotonic()
            rate = tally.outcomes.total() / (shown - start)
            print(f"{tally.outcomes.total()} inputs, {rate:.0f}/s, {len(tally.findings)} findings", file=sys.stderr)


def main(words: Sequence[str] | None = None) -> int:
    """Command line; 1 if there are findings."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kind", choices=KINDS, default="mutants", help="kind of inputs")
    parser.add_argument("--compare", action="store_true", help="decode every file with both engines and compare them")
    parser.add_argument("--first", type=int, default=0, help="number of the first input")
    parser.add_argument("--count", type=int, default=20_000, help="number of inputs")
    parser.add_argument("--seed", type=int, default=1, help="seed of all damage")
    parser.add_argument("--jobs", type=int, default=2, help="number of processes")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="minutes after which no work is started")
    parser.add_argument("--seconds", type=float, default=SECONDS, help="seconds of the processor for an input")
    parser.add_argument("--memory", type=int, default=MEMORY >> 20, help="MiB for an input, 0 for no limit")
    parser.add_argument("--one", type=int, help="write input N to stdout instead")
    arguments = parser.parse_args(words)
    make = KINDS[arguments.kind](arguments.seed, arguments.compare)
    if arguments.one is not None:
        sys.stdout.buffer.write(make(arguments.one).data)
        return 0
    numbers = range(arguments.first, arguments.first + arguments.count)
    until = time.monotonic() + 60 * arguments.minutes
    tally = run_campaign(Examiner(make, arguments.seconds, arguments.memory << 20), numbers, arguments.jobs, until)
    shown = {"outcomes": dict(tally.outcomes.most_common()), "slowest": tally.slowest, "findings": tally.findings}
    print(json.dumps({"inputs": tally.outcomes.total(), **shown}, indent=1))
    return bool(tally.findings)


if __name__ == "__main__":
    sys.exit(main())
