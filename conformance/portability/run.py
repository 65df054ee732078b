"""The reference decoder on emulated processors, scored by the suite: exact arrays must be equal to the bit.

    python -m conformance.portability                              half an hour; rewrites the page
    python -m conformance.portability --only 'valid/*' --no-write  some vectors, a few minutes

Emulated code is 20 to 50 times slower, so vectors are decoded to their last layer only.
"""

from __future__ import annotations

import argparse
import datetime
import json
import re
import subprocess
import threading
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from scarfmt_conformance.manifest import RESULTS, Selection, Suite, Vector, find_suite, load_expectation, load_suite
from scarfmt_conformance.process import Limits
from scarfmt_conformance.runner import FAILED, PASSED, Options, Result, run
from scarfmt_conformance.session import Session

from benchmarks.report import dated, load_results, replace_section, save_results, table
from conformance.portability.machines import MACHINES, REPOSITORY, SUITE, System, Unavailable, make_system

FOLDER = REPOSITORY / "build" / "portability"
PAGE = REPOSITORY / "docs" / "stability.md"
NAME = "portability"
_LIMITS = Limits(seconds=900.0, memory_bytes=8 << 30)
_OF_LIMITS = re.compile("/(limit|work)-")
_PROBE = Path(__file__).resolve().parent / "probe.py"


def chosen(suite: Suite, only: Sequence[str]) -> list[Vector]:
    """The vectors whose ids fit one of the patterns, none for all, the smallest first.

    Those of limits stay out: they take hours here, and test no arithmetic.

    Raises:
        InvalidInput: ``input-options``: there are none.
    """
    fit = Selection(only=tuple(only)).of(suite.vectors)
    return sorted((v for v in fit if not _OF_LIMITS.search(v.id)), key=lambda vector: (vector.bytes, vector.id))


def score(system: System, suite: Suite, vectors: Sequence[Vector]) -> dict[str, Any]:
    """Ask the decoder of a system about vectors.

    Returns:
        What the machine says it is, how many vectors passed of each result, the exact arrays compared, and the ids
        of those that failed.

    Raises:
        RuntimeError: the system does not run, or is not what it should be.
    """
    found = _probe(system)
    words = system.command("-m", "scarfmt_conformance.reference.answers", "--session")
    scored = run(
        suite, vectors, lambda stop: Session(words, _LIMITS, stop), Options(last_layer=True), _Told(len(vectors))
    )
    if scored.handshake is not None:
        raise RuntimeError(f"{scored.handshake.message}\n{scored.handshake.errors}")
    passed = [result.vector for result in scored.results if result.outcome == PASSED]
    return {
        **found,
        "asked": len(vectors),
        **{result: sum(vector.result == result for vector in passed) for result in RESULTS},
        "arrays": sum(map(_exact_arrays, passed)),
        "failed": [result.vector.id for result in scored.results if result.outcome == FAILED],
        "seconds": round(scored.seconds),
    }


def _probe(system: System) -> dict[str, Any]:
    done = subprocess.run(system.command(str(_PROBE)), capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{system.machine.name} does not run: {done.stderr.strip()}")
    found: dict[str, Any] = json.loads(done.stdout)
    if (found["byteorder"], found["kernel"]) != (system.machine.byteorder, system.kernel):
        raise RuntimeError(f"{system.machine.name} is not what was asked for: {found}")
    return found


def _exact_arrays(vector: Vector) -> int:
    """How many arrays are pinned by hash in the last layer of a vector."""
    layers = load_expectation(vector).layers if vector.result == "decoded" else ()
    stages = layers[-1].stages if layers else {}
    return sum(len(stage.get("arrays", ())) for name, stage in stages.items() if name != "activated")


class _Told:
    """Prints a line per vector, so that hours of work can be watched."""

    def __init__(self, total: int) -> None:
        self._total, self._done, self._lock = total, 0, threading.Lock()

    def __call__(self, result: Result) -> None:
        with self._lock:
            self._done += 1
            failure = f"  {result.failure.message}" if result.failure else ""
            place = f"{self._done}/{self._total}"
            print(f"  {place}  {result.outcome}  {result.seconds:.1f} s  {result.vector.id}{failure}", flush=True)


def page_section(results: dict[str, Any]) -> str:
    """The results as the section of the page."""
    head = ("processor", "byte order", "kernel", "Python, numpy",
            "decoded", "exact arrays", "refused", "either", "failed", "run")  # fmt: skip
    rows = [
        (
            *(way["processor"], way["byteorder"], "compiled" if way["kernel"] else "none"),
            f"{way['python']}, {way['numpy']}",
            *(f"{way[name]:,}" for name in ("decoded", "arrays", "refused", "either")),
            *(f"{len(way['failed']):,}", f"{way['date']}, {way['commit'][:10]}"),
        )
        for _, way in sorted(results["ways"].items())
    ]
    note = f"Debian {results['debian']} under {results['emulator']}."
    return f"{table(head, rows, 4)}\n{note}"


def _recorded(ways: dict[str, dict[str, Any]], commit: str) -> dict[str, Any]:
    """The results kept, those just found in the place of older ones of the same processor and way."""
    date = datetime.datetime.now(datetime.UTC).date().isoformat()
    found = {name: {**way, "commit": commit, "date": date} for name, way in ways.items()}
    return {
        "ways": {**load_results(NAME).get("ways", {}), **found},
        "debian": SUITE,
        "emulator": _line(MACHINES[0].qemu[0], "--version"),
    }


def _line(*words: str) -> str:
    done = subprocess.run(words, capture_output=True, text=True, check=True, cwd=REPOSITORY)
    return done.stdout.splitlines()[0]


def main(arguments: list[str]) -> int:
    """Run the vectors on the machines asked for; returns the exit status, 1 if any failed."""
    parser = argparse.ArgumentParser(prog="python -m conformance.portability")
    names = [emulated.name for emulated in MACHINES]
    parser.add_argument("--machines", nargs="+", choices=names, default=names, help="processors [default: all]")
    parser.add_argument("--kernel", choices=("both", "with", "without"), default="both", help="the compiled kernel")
    parser.add_argument("--only", nargs="+", default=[], metavar="GLOB", help="only vectors whose ids match")
    parser.add_argument("--no-write", action="store_true", help="JSON goes to build/bench/ only")
    options = parser.parse_args(arguments)
    suite = load_suite(find_suite(str(REPOSITORY / "conformance")))
    vectors = chosen(suite, options.only)
    kernels = {"both": (True, False), "with": (True,), "without": (False,)}[options.kernel]
    commit = _line("git", "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*")
    try:
        systems = [make_system(known, FOLDER) for known in MACHINES if known.name in options.machines]
    except Unavailable as error:
        parser.error(str(error))
    failed = 0
    for system in (replace(system, kernel=kernel) for kernel in kernels for system in systems):
        name = f"{system.machine.name} {'with' if system.kernel else 'without'} kernel"
        print(name, flush=True)
        way = score(system, suite, vectors)
        failed += len(way["failed"])
        _keep(_recorded({name: way}, commit), write=not options.no_write)
    return 1 if failed else 0


def _keep(results: dict[str, Any], write: bool) -> None:
    save_results(NAME, results, keep=write)
    if write:
        replace_section(NAME, dated(page_section(results), NAME), PAGE)
