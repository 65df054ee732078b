"""The five benchmark programs, one after the other, each in a process of its own.

    python -m benchmarks.all --short                 the example scene; prints, and writes to build/bench/ alone
    python -m benchmarks.all --full                  every scene found; rewrites tables and plots of README.md and docs/
    python -m benchmarks.all --full --only quality time

A program that fails does not stop the others; the exit status is 1 if any failed. `trained` has a short run alone: its
full runs need captures and hours, see there. `quality` comes first: the files it encodes are used again by the others.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time

from benchmarks.report import table
from benchmarks.scenes import REPOSITORY

SHORT = ("--short", "--no-write")
PROGRAMS: dict[str, tuple[str, ...]] = {
    "quality": (),
    "rivals": (),
    "trained": ("--report",),
    "time": (),
    "scale": ("--gaussians", "10000000", "--workers", "1", "2"),
    "pictures": (),
}
"""Arguments of each program in the full mode."""
ENVIRONMENT = {"OMP_WAIT_POLICY": "passive", "OPENBLAS_NUM_THREADS": "1"}


def main() -> int:
    """The command line; the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    mode = parser.add_mutually_exclusive_group(required=True)
    mode.add_argument("--short", action="store_true", help="some minutes; needs no scene but the example")
    mode.add_argument("--full", action="store_true", help="everything, hours")
    parser.add_argument("--only", nargs="+", choices=PROGRAMS, default=list(PROGRAMS), metavar="NAME")
    arguments = parser.parse_args()
    rows, failed = [], False
    for name, full in PROGRAMS.items():
        if name not in arguments.only:
            continue
        words = [name, *(SHORT if arguments.short else full)]
        print(f"--- {' '.join(words)}", file=sys.stderr, flush=True)
        began = time.perf_counter()
        command = [sys.executable, "-m", f"benchmarks.{words[0]}", *words[1:]]
        status = subprocess.run(command, cwd=REPOSITORY, env={**ENVIRONMENT, **os.environ}).returncode
        rows.append([name, f"{time.perf_counter() - began:.0f}", f"failed: exit status {status}" if status else ""])
        failed |= status != 0
    print("\n" + table(["program", "s", ""], rows))
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
