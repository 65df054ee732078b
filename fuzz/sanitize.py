"""The C library under AddressSanitizer and UndefinedBehaviorSanitizer, on sound, damaged and forged files.

``python -m fuzz.sanitize --minutes 2`` builds the library with gcc's sanitizers in ``build/sanitize/`` and, with it in
place of the installed one, takes files through decode and validate: every file of the corpus, then turn by turn a
mutant of any kind and one that is forged deep inside and sealed again, so that what no checksum stops reaches the C
code. Any report of a sanitizer, and any exception that is no ScarError, ends the run with exit code 1; the file is kept
in ``fuzz/findings/``. Input n of seed S is always the same file. Needs gcc on Linux.
"""

from __future__ import annotations

import argparse
import itertools
import os
import shutil
import subprocess
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from fuzz.corpus import Seed, corpus
from fuzz.inputs import Inputs
from fuzz.target import decoded, truncated, validated

REPOSITORY = Path(__file__).resolve().parents[1]
BUILD = REPOSITORY / "build" / "sanitize"
FINDINGS = REPOSITORY / "fuzz" / "findings"
FLAGS = ("-g", "-O1", "-fno-omit-frame-pointer", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
# Python frees little at its end; and every report is to end the process at once.
OPTIONS = {"ASAN_OPTIONS": "detect_leaks=0:abort_on_error=0", "UBSAN_OPTIONS": "print_stacktrace=1"}
_TRUNCATE_EVERY = 8
_SHOW_EVERY = 30.0


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


def run_under_sanitizers(arguments: list[str], folder: Path = BUILD) -> int:
    """The exit code of this module's `--inside` with the sanitizers loaded before Python itself."""
    runtime = subprocess.run(["gcc", "-print-file-name=libasan.so"], check=True, capture_output=True, text=True)
    # Through malloc, every bytes object and array has ends that are watched.
    environment = {**os.environ, **OPTIONS, "LD_PRELOAD": runtime.stdout.strip(), "PYTHONMALLOC": "malloc"}
    environment["PYTHONPATH"] = f"{folder}{os.pathsep}{REPOSITORY}"
    command = [sys.executable, "-m", "fuzz.sanitize", "--inside", str(folder), *arguments]
    return subprocess.run(command, cwd=folder, env=environment, check=False).returncode


def inputs(files: list[Seed], seed: int) -> Iterator[tuple[str, bytes]]:
    """(name, bytes) of every file as it is, then mutants of any kind and deep ones by turns, without end."""
    yield from ((file.name, file.data) for file in files)
    kinds = Inputs(files, seed), Inputs([file for file in files if not decoded(file.data)], seed, "deep")
    for number in itertools.count():
        one = kinds[number % 2](number)
        yield one.name, one.mutant.data


def work(folder: Path, seed: int, minutes: float) -> int:
    """Take all files of the corpus through the code, then mutants for some minutes; the exit code."""
    current = folder / "current.scar"
    shown = until = time.monotonic()
    files = corpus()
    outcomes: Counter[str] = Counter()
    for count, (name, data) in enumerate(inputs(files, seed)):
        now = time.monotonic()
        if count == len(files):
            until = now + 60 * minutes
        if count >= len(files) and now >= until:
            break
        if now - shown > _SHOW_EVERY:
            shown = now
            print(f"{count} files", flush=True)
        # What a report is about must outlive the process.
        current.write_bytes(data)
        (folder / "current.txt").write_text(name)
        refusal = decoded(data)
        outcomes["refused" if refusal else "decoded"] += 1
        validated(data)
        if count % _TRUNCATE_EVERY == 0:
            truncated(data)
    if str(folder / "scarfmt" / "native" / "native.so") not in Path("/proc/self/maps").read_text():
        print("the library with sanitizers was never loaded", file=sys.stderr)
        return 1
    print(f"{outcomes.total()} files ({len(files)} of the corpus), {dict(outcomes)}: no report")
    return 0


def _keep(folder: Path) -> None:
    """Say which file the run ended at, and keep it."""
    if not (folder / "current.scar").exists():
        return
    FINDINGS.mkdir(exist_ok=True)
    kept = FINDINGS / "sanitize.scar"
    shutil.copyfile(folder / "current.scar", kept)
    print(f"ended at input {(folder / 'current.txt').read_text()}, kept as {kept}", file=sys.stderr)


def main() -> int:
    """Command line; 1 if there is a report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=5.0, help="minutes of mutants, after all files of the corpus")
    parser.add_argument("--seed", type=int, default=1, help="seed of the mutants")
    parser.add_argument("--inside", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.inside is not None:
        return work(arguments.inside, arguments.seed, arguments.minutes)
    build()
    code = run_under_sanitizers(["--seed", str(arguments.seed), "--minutes", str(arguments.minutes)])
    if code:
        _keep(BUILD)
    return bool(code)


if __name__ == "__main__":
    sys.exit(main())
