"""Provenance of results: when, with which code and on which machine every figure of a JSON was measured.

A file of results holds figures by name and, under `FIELD`, the runs that measured them. `stamped` writes it for every
benchmark and campaign: names that a run did not measure keep the run they had. Pages show `statement`.
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

from scarfmt.engines import absence

REPOSITORY = Path(__file__).resolve().parents[1]
FIELD = "provenance"
MEASURED, FROM_HISTORY = "while measuring", "from history"
"""Values of a run's ``recorded``: written by the run itself, or found later in the history of the file of results."""
EVERYTHING = "everything"
_PACKAGES = ("numpy", "torch", "numba")
_DIGITS = 12

Run = dict[str, Any]
Document = dict[str, Any]


def now() -> Run:
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


def stamped(
    results: Document, earlier: Document | None = None, measured: Collection[str] | None = None, depth: int = 1
) -> Document:
    """`results` with the runs that measured them.

    Args:
        results: figures by name, in the order they are kept in.
        earlier: the stamped file they replace.
        measured: names that this run measured; None for all.
        depth: 1 where a name at the top is measured at once, 2 where it is a section of names, SECTION/NAME.
    """
    current, before = now(), earlier or {}
    old = list(_names(figures(before), depth))
    known = {name: run for run in before.get(FIELD, ()) for name in (old if run["of"] == EVERYTHING else run["of"])}
    names = _names(results, depth)
    runs = {name: current if measured is None or name in measured else known.get(name, current) for name in names}
    return {FIELD: grouped(runs), **results}


def grouped(runs: Mapping[str, Run]) -> list[Run]:
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
    """A sentence for each run that measured figures of `document`.

    Args:
        section: counts only names that begin with it.
        ending: counts only names that end with it.

    Raises:
        ValueError: none of its runs says so.
    """
    lines = []
    for run in document.get(FIELD, ()):
        names = [] if run["of"] == EVERYTHING else _chosen(run["of"], section, ending)
        if names or run["of"] == EVERYTHING:
            lines.append((", ".join(name.removeprefix(section).replace("/", ", ") for name in names), _sentence(run)))
    if not lines:
        raise ValueError(f"no run is known of the figures {section or 'of this file'}")
    if len(lines) == 1:
        return lines[0][1]
    return "\n".join(f"- {names}: {text}" for names, text in lines)


def _chosen(names: Collection[str], section: str, ending: str) -> list[str]:
    return [name for name in names if name.startswith(section) and name.endswith(ending)]


def _sentence(run: Run) -> str:
    """When, at which commit and on what."""
    commit = f"commit `{run['commit']}`" if run["commit"] else "an unknown commit"
    if run["recorded"] == FROM_HISTORY:
        when = f"Recorded on {run['date']} with {commit} (read from the history of the file)"
    else:
        when = f"Measured on {run['date']} at {commit}{', with changes' if run['modified'] else ''}"
    return f"{when}, {_place(run['machine'])}."


def _place(found: Mapping[str, Any]) -> str:
    """The machine in words; what is not known of it is left out."""
    parts = [f"on {found['cores']} cores of {found['cpu']}" if found.get("cpu") else "on a machine not recorded"]
    parts += [str(found["os"])] if found.get("os") else []
    named = [("python", "Python"), *((name, name) for name in _PACKAGES), ("kernel", "kernel")]
    return ", ".join([*parts, *(f"{word} {found[key]}" for key, word in named if found.get(key))])
