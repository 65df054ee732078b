"""A mutation campaign: damaged files through decode, truncate and validate, under limits of memory and time.

``python -m fuzz.campaign --count 100000 --seed 1 --jobs 2`` prints and saves (``--out``) counts per operator, outcome
and refusal id, the slowest and hungriest inputs, and findings: anything but a result or a ScarError, more than 5 s of
the processor, or more than 512 MiB. The bytes of findings go to ``fuzz/findings/``. Input n of seed S is always the
same file.

``--kind deep`` changes what sound files say and makes all checksums right, so that most inputs reach the decoder of
symbols. ``--kind bit-flips`` flips single bits of sound files, each of which must be noticed. ``--compare`` decodes
every input in NumPy alone, too, and another answer than the C library's is a finding.
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
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from multiprocessing.connection import Connection, wait
from pathlib import Path
from types import FrameType
from typing import Any

from benchmarks.provenance import stamp
from fuzz.corpus import Seed, corpus, digest
from fuzz.inputs import KINDS, Input, Inputs
from fuzz.target import decoded, decoded_by, dumped, truncated, validated

SECONDS = 5.0
"""Maximum processor time per input and question, seconds. Other programs on a machine do not count."""
MEMORY = 512 << 20
"""Per input, for inputs below 1 MiB."""
HUNG = 60.0
"""A process that is stuck below Python, where no alarm reaches it, is killed after so long."""
BATCH = 500
FINDINGS = Path(__file__).with_name("findings")
ENGINES = {"native": partial(decoded_by, native=True), "numpy": partial(decoded_by, native=False)}
_MEASURED = 4 << 20
_KEPT = 10
_TRUNCATE_EVERY = 8
_SHOW_EVERY = 30.0


class Hang(BaseException):
    """An input took more processor time than SECONDS."""


@dataclass
class Tally:
    """The totals of a batch."""

    inputs: int = 0
    bytes: int = 0
    operators: Counter[str] = field(default_factory=Counter)
    outcomes: Counter[str] = field(default_factory=Counter)
    refusals: Counter[str] = field(default_factory=Counter)
    invalid: Counter[str] = field(default_factory=Counter)
    seconds: float = 0.0
    slowest: list[tuple[float, str]] = field(default_factory=list)
    hungriest: list[tuple[int, str]] = field(default_factory=list)
    findings: list[dict[str, Any]] = field(default_factory=list)

    def add(self, other: Tally) -> None:
        """Take another batch in."""
        self.inputs += other.inputs
        self.bytes += other.bytes
        self.seconds += other.seconds
        self.operators += other.operators
        self.outcomes += other.outcomes
        self.refusals += other.refusals
        self.invalid += other.invalid
        self.slowest = sorted(self.slowest + other.slowest, reverse=True)[:_KEPT]
        self.hungriest = sorted(self.hungriest + other.hungriest, reverse=True)[:_KEPT]
        self.findings += other.findings


def on_alarm(_signal: int, _frame: FrameType | None) -> None:
    """End the input that the processor time ran out for."""
    raise Hang


def _peak() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss << 10


def _forget_peak() -> None:
    """Begin a new high-water mark of memory (Linux)."""
    with open("/proc/self/clear_refs", "w") as stream:
        stream.write("5")


class Examiner:
    """Takes inputs through everything that reads files, one by one.

    Args:
        make: input n.
        must_refuse: whether an input that validate takes is a finding.
        engines: of two or none; another answer of the second is a finding.
        findings: folder for their bytes.
    """

    def __init__(
        self,
        make: Callable[[int], Input],
        must_refuse: bool = False,
        engines: Mapping[str, Callable[[bytes], str]] | None = None,
        findings: Path = FINDINGS,
    ) -> None:
        self.make, self._findings = make, findings
        self._must_refuse, self._engines = must_refuse, engines or {}
        self._base = 0

    def run(self, numbers: Iterable[int], begin: Callable[[int], object] = bool) -> Tally:
        """All inputs of a batch; `begin` is called with the number of each."""
        tally = Tally()
        for number in numbers:
            begin(number)
            one = self.make(number)
            tally.inputs += 1
            tally.bytes += len(one.mutant.data)
            tally.operators.update(one.mutant.operators)
            self._examine(one, tally)
        return tally

    def _examine(self, one: Input, tally: Tally) -> None:
        if not self._base:
            _forget_peak()
            self._base = _peak()
        refusal = self._ask("decode", decoded, one, tally)
        finding = self._ask("validate", validated, one, tally)
        self._ask("dump", dumped, one, tally)
        if one.number % _TRUNCATE_EVERY == 0:
            self._ask("truncate", truncated, one, tally)
        answers = [self._ask(f"{name} engine", act, one, tally) for name, act in self._engines.items()]
        if len(set(answers)) > 1 and None not in answers:
            self.found(one, tally, "engines differ", ", ".join(answer or "values" for answer in answers))
        if refusal is not None and finding is not None:
            tally.refusals[refusal or "decoded"] += 1
            tally.invalid[finding or "valid"] += 1
            # The converse is false, by rules marked (V), and as a decoder reads no block it has no need of (SPEC §5.6).
            if refusal and not finding:
                self.found(one, tally, "disagree", f"decode refuses {refusal}, validate finds nothing")
            if self._must_refuse and not finding:
                self.found(one, tally, "unnoticed", "valid")
        peak = _peak() - self._base
        if peak > _MEASURED:
            tally.hungriest = sorted([*tally.hungriest, (peak, one.name)], reverse=True)[:_KEPT]
            if peak > MEMORY and len(one.mutant.data) < 1 << 20:
                self.found(one, tally, "memory", f"{peak >> 20} MiB")
            self._base = 0

    def _ask(self, what: str, act: Callable[[bytes], str], one: Input, tally: Tally) -> str | None:
        signal.setitimer(signal.ITIMER_PROF, SECONDS)
        start = time.process_time()
        answer: str | None = None
        try:
            answer = act(one.mutant.data)
        except Hang:
            self.found(one, tally, f"{what}: hang", traceback.format_exc(limit=-4))
        except Exception as error:
            self.found(one, tally, f"{what}: {type(error).__name__}", traceback.format_exc(limit=-6))
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
        spent = time.process_time() - start
        tally.seconds += spent
        tally.slowest = sorted([*tally.slowest, (round(spent, 4), f"{what} {one.name}")], reverse=True)[:_KEPT]
        tally.outcomes[f"{what} {'finding' if answer is None else 'refused' if answer else 'accepted'}"] += 1
        return answer

    def found(self, one: Input, tally: Tally, what: str, text: str) -> None:
        """Enter a finding, and keep the bytes."""
        tally.findings.append({"what": what, "input": one.name, "text": text})
        self._findings.mkdir(exist_ok=True)
        (self._findings / f"{one.number}.scar").write_bytes(one.mutant.data)


def _limit_memory() -> None:
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    # Beside the input's own: garbage not yet collected, and the allocator's pools.
    limit = size + MEMORY + (256 << 20)
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


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
        _limit_memory()

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


def run_campaign(examiner: Examiner, count: int, jobs: int, until: float) -> Tally:
    """All inputs, in so many processes; no work is given out after `until`, by `time.monotonic`."""
    todo = (range(start, min(start + BATCH, count)) for start in range(0, count, BATCH))
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
                examiner.found(examiner.make(number), tally, what, "its batch is not counted up to it")
                if number + 1 in job.numbers:
                    rest.append(range(number + 1, job.numbers.stop))
        if time.monotonic() - shown > _SHOW_EVERY:
            shown = time.monotonic()
            print(_progress(tally, shown - start), file=sys.stderr, flush=True)


def _progress(tally: Tally, seconds: float) -> str:
    rate = tally.inputs / seconds
    return f"{tally.inputs} inputs, {rate:.0f}/s, {len(tally.findings)} findings, slowest {tally.slowest[:1]}"


def summary(tally: Tally, seconds: float, arguments: argparse.Namespace, files: list[Seed]) -> dict[str, Any]:
    """The result file."""
    return {
        "count": arguments.count,
        "seed": arguments.seed,
        "jobs": arguments.jobs,
        "kind": arguments.kind,
        "engines_compared": arguments.compare,
        "corpus": {"files": len(files), "sha256": digest(files)},
        "inputs": tally.inputs,
        "bytes": tally.bytes,
        "wall_seconds": round(seconds, 1),
        "milliseconds_an_input": round(1000 * tally.seconds / max(tally.inputs, 1), 3),
        "outcomes": dict(sorted(tally.outcomes.items())),
        "operators": dict(sorted(tally.operators.items())),
        "refusals": dict(tally.refusals.most_common()),
        "first_validation_errors": dict(tally.invalid.most_common()),
        "slowest_seconds": tally.slowest,
        "most_bytes": tally.hungriest,
        "findings": tally.findings,
    }


def main() -> int:
    """Command line; 1 if there are findings."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=20_000, help="number of inputs")
    parser.add_argument("--kind", choices=KINDS, default="mutants", help="kind of damage")
    parser.add_argument("--compare", action="store_true", help="decode every input with both engines and compare them")
    parser.add_argument("--seed", type=int, default=1, help="seed of all damage")
    parser.add_argument("--jobs", type=int, default=2, help="number of processes")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="minutes after which no work is started")
    parser.add_argument("--out", type=Path, help="result file, JSON")
    parser.add_argument("--one", type=int, help="write input N to stdout instead")
    arguments = parser.parse_args()
    files = corpus()
    if arguments.kind != "mutants":
        files = [file for file in files if not decoded(file.data)]
    make = Inputs(files, arguments.seed, arguments.kind)
    if arguments.one is not None:
        sys.stdout.buffer.write(make(arguments.one).mutant.data)
        return 0
    start = time.monotonic()
    until = start + 60 * arguments.minutes
    examiner = Examiner(make, arguments.kind == "bit-flips", ENGINES if arguments.compare else None)
    tally = run_campaign(examiner, arguments.count, arguments.jobs, until)
    result = json.dumps(stamp(summary(tally, time.monotonic() - start, arguments, files)), indent=1)
    if arguments.out is not None:
        arguments.out.write_text(result + "\n")
    print(result)
    return bool(tally.findings)


if __name__ == "__main__":
    sys.exit(main())
