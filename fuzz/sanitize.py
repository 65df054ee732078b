"""The C library under AddressSanitizer and UndefinedBehaviorSanitizer, on sound, damaged and forged files.

``python -m fuzz.sanitize --minutes 2`` builds the library with gcc's sanitizers in ``build/sanitize/`` and, with it in
place of the installed one, runs two campaigns (:mod:`fuzz.campaign`): files that are forged deep inside and sealed
again, so that what no checksum stops reaches the C code, and mutants of any kind; first every file of the corpus as it
is. Any report of a sanitizer ends its process, and is a finding. Needs gcc on Linux.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

from fuzz import campaign

REPOSITORY = Path(__file__).resolve().parents[1]
BUILD = REPOSITORY / "build" / "sanitize"
FLAGS = ("-g", "-O1", "-fno-omit-frame-pointer", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
# Python frees little at its end; and every report is to end the process at once, with a status no campaign ends with.
OPTIONS = {"ASAN_OPTIONS": "detect_leaks=0:exitcode=99", "UBSAN_OPTIONS": "print_stacktrace=1:exitcode=99"}
# A slower decode, and memory that is kept from being used again, are no findings.
LIMITS = ("--seconds", "60", "--memory", "0", "--jobs", "1")


def build(sources: Path = REPOSITORY / "scarfmt" / "native", folder: Path = BUILD) -> Path:
    """A copy of the package in `folder` whose C library is compiled from `sources` with the sanitizers.

    Raises:
        subprocess.CalledProcessError: gcc refuses the sources, or has no sanitizers.
    """
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(
        REPOSITORY / "scarfmt", folder / "scarfmt", ignore=shutil.ignore_patterns("__pycache__", "*.so", "*.c", "*.h")
    )
    library = folder / "scarfmt" / "native" / "native.so"
    settings = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["tool"]["setuptools"]["ext-modules"][0]
    files = [str(sources / Path(name).name) for name in settings["sources"]]
    subprocess.run(["gcc", "-shared", "-fPIC", *FLAGS, "-o", str(library), *files], check=True)
    return library


def run_under_sanitizers(arguments: list[str]) -> int:
    """The exit code of this module's `--inside` with the sanitizers loaded before Python itself."""
    runtime = subprocess.run(["gcc", "-print-file-name=libasan.so"], check=True, capture_output=True, text=True)
    # Through malloc, every bytes object and array has ends that are watched.
    environment = {**os.environ, **OPTIONS, "LD_PRELOAD": runtime.stdout.strip(), "PYTHONMALLOC": "malloc"}
    environment["PYTHONPATH"] = f"{BUILD}{os.pathsep}{REPOSITORY}"
    command = [sys.executable, "-m", "fuzz.sanitize", "--inside", str(BUILD), *arguments]
    return subprocess.run(command, cwd=BUILD, env=environment, check=False).returncode


def work(folder: Path, seed: str, minutes: float, count: str) -> int:
    """Both campaigns in a process that has the sanitizers; the exit code."""
    often = ("--seed", seed, "--minutes", str(minutes / 2), "--count", count)
    # What is not sound is left out of `deep`: to know that, every file of the corpus is decoded in this process.
    code = max(campaign.main(["--kind", kind, *often, *LIMITS]) for kind in ("deep", "mutants"))
    if str(folder / "scarfmt" / "native" / "native.so") not in Path("/proc/self/maps").read_text():
        print("the library with sanitizers was never loaded", file=sys.stderr)
        return 1
    return code


def main() -> int:
    """Command line; 1 if there is a report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=5.0, help="minutes of mutants, after all files of the corpus")
    parser.add_argument("--seed", default="1", help="seed of the mutants")
    parser.add_argument("--count", default="100000000", help="number of mutants of each kind")
    parser.add_argument("--inside", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.inside is not None:
        return work(arguments.inside, arguments.seed, arguments.minutes, arguments.count)
    build()
    return bool(run_under_sanitizers(["--seed", arguments.seed, "--minutes", str(arguments.minutes)]))


if __name__ == "__main__":
    sys.exit(main())
