"""The reference decoder on emulated processors, scored by the suite: exact arrays must be equal to the bit.

    python -m conformance.portability                   half an hour
    python -m conformance.portability --only 'valid/*'  some vectors, a few minutes

A line a vector is printed, at the end the results as JSON.

Emulated code is 20 to 50 times slower, so vectors are decoded to their last layer only.
"""

from __future__ import annotations

import argparse
import itertools
import json
import re
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from scarfmt_conformance.manifest import RESULTS, Selection, Suite, Vector, find_suite, load_expectation, open_suite
from scarfmt_conformance.process import Limits, Program
from scarfmt_conformance.runner import FAILED, PASSED, Options, Result, run

from benchmarks.provenance import stamp
from conformance.portability.machines import MACHINES, REPOSITORY, SUITE, System, Unavailable, make_system

FOLDER = REPOSITORY / "build" / "portability"
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
    options = ["--native"] if system.native else []
    words = system.command("-m", "scarfmt_conformance.reference.answers", "--session", *options)
    shown = partial(_print, itertools.count(1), len(vectors))
    scored = run(suite, vectors, partial(Program, words, _LIMITS, session=True), Options(last_layer=True), shown)
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
    if (found["byteorder"], found["native"]) != (system.machine.byteorder, system.native):
        raise RuntimeError(f"{system.machine.name} is not what was asked for: {found}")
    return found


def _exact_arrays(vector: Vector) -> int:
    """How many arrays are pinned by hash in the last layer of a vector."""
    layers = load_expectation(vector).layers if vector.result == "decoded" else ()
    stages = layers[-1].stages if layers else {}
    return sum(len(stage.get("arrays", ())) for name, stage in stages.items() if name != "activated")


def _print(done: Iterator[int], total: int, result: Result) -> None:
    """Print a line per vector, so that hours of work can be watched."""
    failure = f"  {result.failure.message}" if result.failure else ""
    place = f"{next(done)}/{total}"
    print(f"  {place}  {result.outcome}  {result.seconds:.1f} s  {result.vector.id}{failure}", flush=True)


def _line(*words: str) -> str:
    done = subprocess.run(words, capture_output=True, text=True, check=True, cwd=REPOSITORY)
    return done.stdout.splitlines()[0]


def main(arguments: list[str]) -> int:
    """Run the vectors on the machines asked for; returns the exit status, 1 if any failed."""
    parser = argparse.ArgumentParser(prog="python -m conformance.portability")
    names = [emulated.name for emulated in MACHINES]
    parser.add_argument("--machines", nargs="+", choices=names, default=names, help="processors [default: all]")
    parser.add_argument("--native", choices=("both", "with", "without"), default="both", help="the C library")
    parser.add_argument("--only", nargs="+", default=[], metavar="GLOB", help="only vectors whose ids match")
    parser.add_argument("--out", type=Path, help="file for the results, JSON")
    options = parser.parse_args(arguments)
    choices = {"both": (True, False), "with": (True,), "without": (False,)}[options.native]
    try:
        systems = [make_system(known, FOLDER) for known in MACHINES if known.name in options.machines]
    except Unavailable as error:
        parser.error(str(error))
    ways: dict[str, dict[str, Any]] = {}
    with open_suite(find_suite(str(REPOSITORY / "conformance"))) as suite:
        vectors = chosen(suite, options.only)
        for system in (replace(system, native=native) for native in choices for system in systems):
            name = f"{system.machine.name} {'with' if system.native else 'without'} C library"
            print(name, flush=True)
            ways[name] = score(system, suite, vectors)
    results = stamp({"ways": ways, "debian": SUITE, "emulator": _line(MACHINES[0].qemu[0], "--version")})
    text = json.dumps(results, indent=1)
    if options.out is not None:
        options.out.write_text(text + "\n", encoding="utf-8")
    print(text)
    return int(any(way["failed"] for way in ways.values()))
