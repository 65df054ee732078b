"""Mutants one after the other in this process, in several runs: a log of what became of them, and limits of each."""

from __future__ import annotations

import argparse
import json
import resource
import signal
import time
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.provenance import describe_run
from fuzz.campaign import FINDINGS, MEMORY, SECONDS, Hang, on_alarm

_SAVE_EVERY = 60.0


@dataclass(frozen=True)
class Case:
    """What became of a mutant.

    Attributes:
        outcome: by which it is counted.
        finding: what is wrong with that; None for nothing.
        data: bytes of a finding.
    """

    outcome: str
    finding: Any = None
    data: bytes = b""


Examine = Callable[[int], Case]
"""Mutant n through the code: always the same. What it raises is a finding."""
Journal = dict[str, Any]


def run(examine: Examine, numbers: range, until: float, log: Path, done: Journal) -> None:
    """Examine some mutants until `until` by `time.monotonic`, and keep the totals in `done` and in the file `log`."""
    outcomes: Counter[str] = Counter(done["outcomes"])
    before, start = done["seconds"], time.monotonic()
    saved = start
    for number in numbers:
        case = _limited(examine, number)
        outcomes[case.outcome] += 1
        if case.finding is not None:
            done["findings"].append({"mutant": number, "outcome": case.outcome, "finding": case.finding})
            FINDINGS.mkdir(exist_ok=True)
            (FINDINGS / f"{log.stem}-{number}").write_bytes(case.data)
        now = time.monotonic()
        done |= {"mutants": number + 1, "outcomes": dict(outcomes.most_common())}
        done["seconds"] = round(before + now - start, 1)
        if now - saved > _SAVE_EVERY or now > until:
            saved = now
            log.write_text(json.dumps(done, indent=1) + "\n")
        if now > until:
            return
    log.write_text(json.dumps(done, indent=1) + "\n")


def _limited(examine: Examine, number: int) -> Case:
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        return examine(number)
    except Hang:
        return Case("hang", traceback.format_exc(limit=-4))
    except Exception as error:
        return Case(type(error).__name__, traceback.format_exc(limit=-6))
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)


def main(description: str | None, prepare: Callable[[int], tuple[str, Examine]]) -> int:
    """Command line; 1 if there are findings.

    Args:
        description: of the program.
        prepare: for a seed, a text that tells one corpus from another, and what examines mutants.
    """
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=20_000, help="number of mutants, those of the log included")
    parser.add_argument("--seed", type=int, default=1, help="seed of all changes")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="minutes after which it stops")
    parser.add_argument("--log", type=Path, required=True, help="result file, JSON")
    arguments = parser.parse_args()
    corpus, examine = prepare(arguments.seed)
    done: Journal = {"seed": arguments.seed, "corpus": corpus, "mutants": 0, "seconds": 0.0}
    done |= {"outcomes": {}, "findings": [], "runs": []}
    if arguments.log.exists():
        before = json.loads(arguments.log.read_text())
        if (before["seed"], before["corpus"]) != (done["seed"], done["corpus"]):
            parser.error("the log is of another seed or corpus")
        done = before
    done["runs"].append({**describe_run(), "from": done["mutants"]})
    signal.signal(signal.SIGPROF, on_alarm)
    limit = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize() + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    until = time.monotonic() + 60 * arguments.minutes
    run(examine, range(done["mutants"], arguments.count), until, arguments.log, done)
    print(f"{done['mutants']} mutants in {done['seconds']} s, {len(done['findings'])} findings")
    return bool(done["findings"])
