"""The reference decoder on emulated processors, scored by the suite: exact arrays must be equal to the bit.

    python -m conformance.portability                   half an hour
    python -m conformance.portability --only 'valid/*'  some vectors, a few minutes

Emulated code is 20 to 50 times slower: vectors are decoded to their last layer only, and those of limits stay out,
which would take hours and test no arithmetic. With the C library, its values are compared with those of NumPy.
"""

from __future__ import annotations

import argparse
import re
import subprocess
from dataclasses import replace
from functools import partial

from scarfmt_conformance.manifest import Selection, Suite, find_suite, open_suite
from scarfmt_conformance.process import Limits, Program
from scarfmt_conformance.report import failures_text
from scarfmt_conformance.runner import Options, Result, run

from conformance.portability.machines import MACHINES, REPOSITORY, System, Unavailable, make_system

FOLDER = REPOSITORY / "build" / "portability"
_LIMITS = Limits(seconds=900.0, memory_bytes=8 << 30)
_OF_LIMITS = re.compile("/(limit|work)-")
_PROBE = "import sys; from scarfmt.native.binding import absence; print(sys.byteorder, absence() is None)"


def score(system: System, suite: Suite, only: tuple[str, ...]) -> bool:
    """Ask the decoder of a system about vectors, the smallest first, and print what it found; whether all passed.

    Raises:
        RuntimeError: the system is not what it should be.
    """
    found = subprocess.run(system.command("-c", _PROBE), capture_output=True, text=True, check=True).stdout.split()
    if found != [system.machine.byteorder, str(system.native)]:
        raise RuntimeError(f"{system.machine.name} is not what was asked for: {found}")
    vectors = [vector for vector in Selection(only=only).of(suite.vectors) if not _OF_LIMITS.search(vector.id)]
    vectors.sort(key=lambda vector: (vector.bytes, vector.id))
    options = ["--native"] if system.native else []
    words = system.command("-m", "scarfmt_conformance.reference.answers", "--session", *options)
    scored = run(suite, vectors, partial(Program, words, _LIMITS, session=True), Options(last_layer=True), _print)
    print(failures_text(scored, len(vectors)))
    return scored.passed


def _print(result: Result) -> None:
    """Print a line per vector, so that hours of work can be watched."""
    print(f"  {result.outcome}  {result.seconds:.1f} s  {result.vector.id}", flush=True)


def main() -> int:
    """Run the vectors on all machines, with the C library and without; the exit status, 1 if any failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", default=[], metavar="GLOB", help="only vectors whose ids match")
    options = parser.parse_args()
    passed = True
    try:
        systems = [make_system(machine, FOLDER) for machine in MACHINES]
    except Unavailable as error:
        parser.error(str(error))
    with open_suite(find_suite(str(REPOSITORY / "conformance"))) as suite:
        for system in (replace(system, native=native) for native in (True, False) for system in systems):
            print(f"{system.machine.name} {'with' if system.native else 'without'} C library", flush=True)
            passed &= score(system, suite, tuple(options.only))
    return int(not passed)
