"""All benchmarks, one after the other, each in a process of its own.

    python -m benchmarks.all --short                 the example scene; prints, and writes to build/bench/ alone
    python -m benchmarks.all --full                  every scene found; rewrites tables and plots of docs/
    python -m benchmarks.all --full --only quality time_error

One that fails does not keep back the others; what each took is told at the end, and the exit status is 1 if any failed.
One that this machine has not got what it takes for, as a GPU, is skipped and says why.
`quality` comes first: the files it encodes are used again by those after it.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

from benchmarks.report import SHORT_RESULTS, SKIPPED, table
from benchmarks.scenes import REPOSITORY

SHORT: tuple[str, ...] = ("--short", "--no-write")
FULL: tuple[str, ...] = ()
COMMANDS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "quality": (SHORT, FULL),
    "positions": (SHORT, FULL),
    "time_error": (SHORT, FULL),
    "rivals_run": (SHORT, FULL),
    "interchange": (SHORT, FULL),
    "time_to_picture": (SHORT, FULL),
    "scaling": (SHORT, FULL),
    "survey_time": (SHORT, FULL),
    "large_scene": (SHORT, ("--gaussians", "10000000", "--workers", "1", "2")),
    "scale_loss": (SHORT, FULL),
    "decoder_costs": (SHORT, FULL),
    "regions": (SHORT, FULL),
    "directory": (SHORT, FULL),
    "stability": (SHORT, FULL),
    "streaming": (SHORT, FULL),
    "detail": (SHORT, FULL),
    "streaming_browser": (SHORT, FULL),
    "streaming_time": (SHORT, FULL),
    "entropy_speed": (SHORT, ("--full",)),
    "entropy_stress": (SHORT, ("--full",)),
    "cuda_equality": (SHORT, FULL),
    "gain": (SHORT, FULL),
    # The table of docs/decisions/0005 has four times as many steps and vectors; what is new shows here, too.
    "latent": (SHORT, ("--no-write", "--steps", "200", "--limit", "5000")),
    "rvq_saturation": (SHORT, FULL),
    "ablation": (SHORT, ("--again",)),
    "mechanisms": (SHORT, FULL),
    "example": (SHORT, FULL),
    "training_step": (SHORT, FULL),
    "pictures": (SHORT, FULL),
}
"""Arguments of every benchmark in the short mode and in the full one."""
ENVIRONMENT = {"OMP_WAIT_POLICY": "passive", "OPENBLAS_NUM_THREADS": "1"}


class Outcome(NamedTuple):
    """The outcome of one benchmark: its exit status and the seconds it took."""

    name: str
    status: int
    seconds: float


Start = Callable[[Sequence[str]], int]


def start(command: Sequence[str]) -> int:
    """Run a command from the repository's root, with the variables that the Makefile sets; its exit status."""
    return subprocess.run(command, cwd=REPOSITORY, env={**ENVIRONMENT, **os.environ}).returncode


def run(names: Iterable[str], full: bool, start: Start = start) -> list[Outcome]:
    """Run benchmarks in the order of `COMMANDS`, whatever becomes of those before."""
    chosen, found = set(names), []
    for name, modes in COMMANDS.items():
        if name not in chosen:
            continue
        arguments = modes[full]
        print(f"--- {name} {' '.join(arguments)}", file=sys.stderr, flush=True)
        began = time.perf_counter()
        status = start([sys.executable, "-m", f"benchmarks.{name}", *arguments])
        found.append(Outcome(name, status, time.perf_counter() - began))
    return found


def summary(outcomes: Sequence[Outcome]) -> str:
    """A table of what each took and whether it did what it should."""
    said = {0: "", SKIPPED: "skipped: above it says why"}
    rows = [[o.name, f"{o.seconds:.0f}", said.get(o.status, f"failed: exit status {o.status}")] for o in outcomes]
    return table(["benchmark", "s", ""], [*rows, ["all", f"{sum(o.seconds for o in outcomes):.0f}", ""]])


def main(arguments: Sequence[str] | None = None, start: Start = start) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    mode = parser.add_mutually_exclusive_group(required=True)
    mode.add_argument("--short", action="store_true", help="some minutes; needs no scene but the example")
    mode.add_argument("--full", action="store_true", help="everything, two hours or more")
    parser.add_argument("--only", nargs="+", choices=COMMANDS, default=list(COMMANDS), metavar="NAME")
    asked = parser.parse_args(arguments)
    outcomes = run(asked.only, asked.full, start)
    text = summary(outcomes)
    print(f"\n{text}")
    SHORT_RESULTS.mkdir(parents=True, exist_ok=True)
    (SHORT_RESULTS / "all.md").write_text(text, encoding="utf-8")
    return int(any(outcome.status not in (0, SKIPPED) for outcome in outcomes))


if __name__ == "__main__":
    sys.exit(main())
