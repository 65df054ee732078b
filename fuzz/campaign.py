"""A mutation campaign: damaged files through decode, truncate and validate, under limits of memory and time.

``python -m fuzz.campaign --count 100000 --seed 1 --jobs 2`` prints and saves (``--out``) counts per operator, outcome
and refusal id, the slowest and hungriest inputs, and findings: anything but a result or a ScarError, more than 5 s of
the processor, or more than 512 MiB. The bytes of findings go to ``fuzz/findings/``. Input n of seed S is always the
same file.

``--kind deep`` changes what sound files say and makes all checksums right, so that most inputs reach the decoder of
symbols. ``--kind bit-flips`` flips single bits of sound files, each of which must be noticed. ``--compare`` decodes
every input in NumPy alone, too, and another answer than the kernel's is a finding.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import queue
import resource
import signal
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path
from types import FrameType
from typing import Any

from benchmarks.provenance import stamped
from fuzz.corpus import Seed, corpus, digest
from fuzz.inputs import KINDS, Input
from fuzz.target import decoded, decoded_by, dumped, truncated, validated

SECONDS = 5.0
"""Maximum processor time per input and question, seconds. Other programs on a machine do not count."""
MEMORY = 512 << 20
"""Per input, for inputs below 1 MiB."""
HUNG = 60.0
"""A worker that is stuck below Python, where no alarm reaches it, is killed after so long."""
BATCH = 500
FINDINGS = Path(__file__).with_name("findings")
_MEASURED = 4 << 20
_KEPT = 10
_TRUNCATE_EVERY = 8


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


def _on_alarm(_signal: int, _frame: FrameType | None) -> None:
    raise Hang


def _peak() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss << 10


def _forget_peak() -> None:
    """Begin a new high-water mark of memory (Linux)."""
    with open("/proc/self/clear_refs", "w") as stream:
        stream.write("5")


@dataclass(frozen=True)
class Rules:
    """The rules by which results are findings, beside exceptions, time and memory.

    Attributes:
        must_refuse: that validate finds nothing in an input.
        compare: that NumPy alone answers otherwise than the engine in use: other values, another refusal id.
    """

    must_refuse: bool = False
    compare: bool = False


class Runner:
    """Runs inputs one by one and keeps the score.

    Args:
        make: input n.
        rules: what else is a finding.
    """

    def __init__(self, make: Callable[[int], Input], rules: Rules) -> None:
        self._make, self._rules = make, rules
        self._base = 0

    def run(self, numbers: Iterator[int], progress: Synchronized[int]) -> Tally:
        """All inputs of a batch; `progress` is the number of the one at work."""
        tally = Tally()
        for number in numbers:
            progress.value = number
            one = self._make(number)
            tally.inputs += 1
            tally.bytes += len(one.mutant.data)
            tally.operators.update(one.mutant.operators)
            self._one(one, tally)
        progress.value = -1
        return tally

    def _one(self, one: Input, tally: Tally) -> None:
        data = one.mutant.data
        if not self._base:
            _forget_peak()
            self._base = _peak()
        refusal = self._ask("decode", decoded, one, tally)
        finding = self._ask("validate", validated, one, tally)
        self._ask("dump", dumped, one, tally)
        if one.number % _TRUNCATE_EVERY == 0:
            self._ask("truncate", truncated, one, tally)
        if self._rules.compare:
            self._engines(one, tally)
        if refusal is not None and finding is not None:
            tally.refusals[refusal or "decoded"] += 1
            tally.invalid[finding or "valid"] += 1
            self._compare(one, refusal, finding, tally)
        peak = _peak() - self._base
        if peak > _MEASURED:
            tally.hungriest = sorted([*tally.hungriest, (peak, one.name)], reverse=True)[:_KEPT]
            if peak > MEMORY and len(data) < 1 << 20:
                self._found(one, tally, "memory", f"{peak >> 20} MiB")
            self._base = 0

    def _engines(self, one: Input, tally: Tally) -> None:
        """Check that both engines give the same arrays, or refuse with the same id."""
        first, second = (
            self._ask(f"{name} engine", partial(decoded_by, engine=name), one, tally, count=False)
            for name in ("auto", "numpy")
        )
        if first is not None and second is not None:
            tally.outcomes["engines compared"] += 1
            if first != second:
                self._found(one, tally, "engines differ", f"in use: {first or 'other values'}, NumPy: {second}")

    def _compare(self, one: Input, refusal: str, finding: str, tally: Tally) -> None:
        """Check that a file whose decoding is refused is not valid. The converse is false, by rules marked (V)."""
        if refusal and not finding:
            self._found(one, tally, "disagree", f"decode refuses {refusal}, validate finds nothing")
        if self._rules.must_refuse and not finding:
            self._found(one, tally, "unnoticed", "valid")
        elif self._rules.must_refuse and not refusal:
            # A decoder does not read blocks it has no need of (SPEC §5.6).
            tally.outcomes["noticed by validate alone"] += 1

    def _ask(
        self, what: str, act: Callable[[bytes], str], one: Input, tally: Tally, count: bool = True
    ) -> str | None:
        signal.setitimer(signal.ITIMER_PROF, SECONDS)
        start = time.process_time()
        answer: str | None = None
        try:
            answer = act(one.mutant.data)
        except Hang:
            self._found(one, tally, f"{what}: hang", traceback.format_exc(limit=-4))
        except Exception as error:
            self._found(one, tally, f"{what}: {type(error).__name__}", traceback.format_exc(limit=-6))
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
        spent = time.process_time() - start
        tally.seconds += spent
        if not tally.slowest or len(tally.slowest) < _KEPT or spent > tally.slowest[-1][0]:
            tally.slowest = sorted([*tally.slowest, (round(spent, 4), f"{what} {one.name}")], reverse=True)[:_KEPT]
        kind = "finding" if answer is None else "refused" if answer else "accepted"
        tally.outcomes[f"{what} {kind}"] += count
        return answer

    @staticmethod
    def _found(one: Input, tally: Tally, what: str, text: str) -> None:
        tally.findings.append({"what": what, "input": one.name, "text": text})
        save(one)


def save(one: Input) -> None:
    """Keep the bytes of a finding."""
    FINDINGS.mkdir(exist_ok=True)
    (FINDINGS / f"{one.number}.scar").write_bytes(one.mutant.data)


def _limit_memory() -> None:
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    # Beside the input's own: garbage not yet collected, and the allocator's pools.
    limit = size + MEMORY + (256 << 20)
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


def _work(
    make: Callable[[int], Input],
    rules: Rules,
    batches: Any,
    results: Any,
    progress: Synchronized[int],
) -> None:
    signal.signal(signal.SIGPROF, _on_alarm)
    _limit_memory()
    runner = Runner(make, rules)
    while (batch := batches.get()) is not None:
        results.put(runner.run(iter(range(*batch)), progress))


@dataclass
class Campaign:
    """Workers and what they found.

    Args:
        make: input n.
        count: inputs.
        jobs: worker processes.
        rules: what else is a finding.
        until: when to give out no more work, by `time.monotonic`.
    """

    make: Callable[[int], Input]
    count: int
    jobs: int
    rules: Rules
    until: float
    tally: Tally = field(default_factory=Tally)

    def run(self) -> Tally:
        """The whole campaign."""
        context = multiprocessing.get_context("fork")
        workers = [_Worker(context, self.make, self.rules) for _ in range(self.jobs)]
        todo = iter(range(0, self.count, BATCH))
        for worker in workers:
            self._feed(worker, todo)
        start = shown = time.monotonic()
        while any(worker.busy for worker in workers):
            for worker in workers:
                done = worker.poll()
                if done is not None:
                    self.tally.add(done)
                    self._feed(worker, todo)
            if time.monotonic() - shown > 30:
                shown = time.monotonic()
                print(_progress(self.tally, shown - start), file=sys.stderr, flush=True)
        for worker in workers:
            worker.stop()
        return self.tally

    def _feed(self, worker: _Worker, todo: Iterator[int]) -> None:
        if worker.rest is not None:
            worker.give(worker.rest)
        elif time.monotonic() < self.until and (start := next(todo, None)) is not None:
            worker.give((start, min(start + BATCH, self.count)))


class _Worker:
    """A process that can die of its inputs; whichever it died of is a finding."""

    def __init__(self, context: Any, make: Callable[[int], Input], rules: Rules) -> None:
        self._context, self._make, self._rules = context, make, rules
        self.rest: tuple[int, int] | None = None
        self.busy = False
        self._start()

    def _start(self) -> None:
        self._batches, self._results = self._context.SimpleQueue(), self._context.Queue()
        self._progress = self._context.Value("q", -1, lock=False)
        arguments = (self._make, self._rules, self._batches, self._results, self._progress)
        self._process = self._context.Process(target=_work, args=arguments, daemon=True)
        self._process.start()

    def give(self, batch: tuple[int, int]) -> None:
        """Start a batch."""
        self.rest, self.busy, self._batch = None, True, batch
        self._seen = (-1, time.monotonic())
        self._batches.put(batch)

    def poll(self) -> Tally | None:
        """The result of the batch, if there is one by now."""
        if not self.busy:
            return None
        try:
            tally = self._results.get(timeout=0.2)
        except queue.Empty:
            return self._check()
        self.busy = False
        assert isinstance(tally, Tally)
        return tally

    def _check(self) -> Tally | None:
        number = self._progress.value
        if number != self._seen[0]:
            self._seen = (number, time.monotonic())
        stuck = time.monotonic() - self._seen[1] > HUNG
        if self._process.is_alive() and not stuck:
            return None
        if not stuck and self._process.exitcode == 1:
            raise RuntimeError(f"the campaign itself failed at input {number}")
        what = "stuck" if stuck else f"died, exit code {self._process.exitcode}"
        self._process.kill()
        self._process.join()
        tally = Tally()
        if number >= 0:
            one = self._make(number)
            save(one)
            tally.findings.append({"what": what, "input": one.name, "text": "batch lost before it"})
        # What came before in the batch is not counted; what comes after is still to be done.
        self.rest = (number + 1, self._batch[1]) if number >= 0 and number + 1 < self._batch[1] else None
        self.busy = False
        self._start()
        return tally

    def stop(self) -> None:
        """End the process."""
        self._batches.put(None)
        self._process.join(10)
        self._process.kill()


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
    make = KINDS[arguments.kind](files, arguments.seed)
    if arguments.one is not None:
        sys.stdout.buffer.write(make(arguments.one).mutant.data)
        return 0
    start = time.monotonic()
    until = start + 60 * arguments.minutes
    rules = Rules(arguments.kind == "bit-flips", arguments.compare)
    tally = Campaign(make, arguments.count, arguments.jobs, rules, until).run()
    result = json.dumps(stamped(summary(tally, time.monotonic() - start, arguments, files)), indent=1)
    if arguments.out is not None:
        arguments.out.write_text(result + "\n")
    print(result)
    return bool(tally.findings)


if __name__ == "__main__":
    sys.exit(main())
