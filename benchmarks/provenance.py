"""Provenance of results: when, with which code and on which machine every figure of a JSON was measured.

A file of results holds figures by name and, under `FIELD`, the runs that measured them. `stamp` writes it for every
program: names that a run did not measure keep the run they had. Pages show `statement`.
"""

from __future__ import annotations

import os
import platform
import subprocess
from collections.abc import Collection, Mapping
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from scarfmt.native.binding import absence

REPOSITORY = Path(__file__).resolve().parents[1]
FIELD = "provenance"
MEASURED = "while measuring"
"""Value of a run's ``recorded``: written by the run itself."""
EVERYTHING = "everything"
_PACKAGES = ("numpy", "torch", "numba")
_DIGITS = 12

Run = dict[str, Any]
Document = dict[str, Any]


def describe_run() -> Run:
    """The run of this moment.

    Returns:
        ``recorded``; ``date``, YYYY-MM-DD in UTC; ``commit``, 12 hex digits, null outside a checkout; ``modified``,
        whether source files differ from it; ``machine``, see `machine`.
    """
    changed = _git("status", "--porcelain", "--untracked-files=no", "--", "*.py", "*.c", "*.h", "*.mjs")
    return {
        "recorded": MEASURED,
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "commit": _git("rev-parse", f"--short={_DIGITS}", "HEAD"),
        "modified": bool(changed),
        "machine": machine(),
    }


def machine() -> dict[str, Any]:
    """Processor, number of cores, system, versions of Python and of packages, and whether the kernel is in use."""
    return {
        "cpu": _processor(),
        "cores": os.cpu_count(),
        "os": platform.platform(terse=True),
        "python": platform.python_version(),
        **{name: _version(name) for name in _PACKAGES},
        "kernel": "on" if absence() is None else "off",
    }


def _processor() -> str:
    information = Path("/proc/cpuinfo")
    if information.exists():
        for line in information.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":")[1].strip()
    return platform.processor() or platform.machine()


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _git(*arguments: str) -> str | None:
    """The output of git; None if there is no git or no checkout."""
    try:
        done = subprocess.run(["git", *arguments], cwd=REPOSITORY, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.strip()


def figures(document: Document) -> Document:
    """A file of results without its provenance."""
    return {name: value for name, value in document.items() if name != FIELD}


def stamp(
    results: Document, earlier: Document | None = None, measured: Collection[str] | None = None, depth: int = 1
) -> Document:
    """`results` with the runs that measured them.

    Args:
        results: figures by name, in the order they are kept in.
        earlier: the stamped file they replace.
        measured: names that this run measured; None for all.
        depth: 1 where a name at the top is measured at once, 2 where it is a section of names, SECTION/NAME.
    """
    current, before = describe_run(), earlier or {}
    old = list(_names(figures(before), depth))
    known = {name: run for run in before.get(FIELD, ()) for name in (old if run["of"] == EVERYTHING else run["of"])}
    names = _names(results, depth)
    runs = {name: current if measured is None or name in measured else known.get(name, current) for name in names}
    return {FIELD: group_runs(runs), **results}


def group_runs(runs: Mapping[str, Run]) -> list[Run]:
    """Different runs, in the order of their dates; each with its names under ``of``, where there are several."""
    found: list[Run] = []
    for name, run in runs.items():
        bare = {key: value for key, value in run.items() if key != "of"}
        same = next((other for other in found if {**other, "of": None} == {**bare, "of": None}), None)
        if same is None:
            found.append(same := {**bare, "of": []})
        same["of"].append(name)
    if len(found) == 1:
        found[0]["of"] = EVERYTHING
    return sorted(found, key=lambda run: str(run["date"]))


def _names(results: Document, depth: int) -> list[str]:
    """Names of what is measured at once."""
    if depth == 1:
        return list(results)
    return [f"{section}/{name}" for section, named in results.items() for name in named]


def statement(document: Document, section: str = "", ending: str = "") -> str:
    """When and on what the figures of `document` were measured, in a sentence.

    The file of results says which run measured which figure, and at which commit.

    Args:
        section: counts only names that begin with it.
        ending: counts only names that end with it.

    Raises:
        ValueError: no run of these figures is known.
    """
    runs = [run for run in document.get(FIELD, ()) if run["of"] == EVERYTHING or _covers(run["of"], section, ending)]
    if not runs:
        raise ValueError(f"no run is known of the figures {section or 'of this file'}")
    dates = sorted({run["date"] for run in runs})
    when = dates[0] if len(dates) == 1 else f"{dates[0]} to {dates[-1]}"
    return f"Measured {when} on {' and '.join(dict.fromkeys(_place(run['machine']) for run in runs))}."


def _covers(names: Collection[str], section: str, ending: str) -> bool:
    return any(name.startswith(section) and name.endswith(ending) for name in names)


def _place(found: Mapping[str, Any]) -> str:
    """The machine in words. System and versions of packages are in the file of results."""
    parts = [f"{found['cores']} cores of {found['cpu']}" if found.get("cpu") else "a machine not recorded"]
    parts += [f"kernel {found['kernel']}"] if found.get("kernel") == "off" else []
    return ", ".join(parts)
