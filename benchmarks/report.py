"""Results as JSON next to the scripts, and as tables between markers of a page of docs/."""

from __future__ import annotations

import argparse
import json
import os
import platform
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from benchmarks.scenes import REPOSITORY

RESULTS = REPOSITORY / "benchmarks" / "results"
PAGE = REPOSITORY / "docs" / "benchmarks.md"
# Encoded files, kept between commands; not part of the repository.
SCRATCH = REPOSITORY / "build" / "benchmarks"
# Results of runs that keep nothing.
SHORT_RESULTS = REPOSITORY / "build" / "bench"


def load_results(name: str) -> dict[str, Any]:
    """Earlier results of benchmark `name`; scenes can be measured one at a time and are merged."""
    path = RESULTS / f"{name}.json"
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else {}


def save_results(name: str, results: dict[str, Any], keep: bool = True) -> None:
    """Keep the results of benchmark `name`; without `keep`, only under build/bench/, for a look at them."""
    folder = RESULTS if keep else SHORT_RESULTS
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(results, indent=1, sort_keys=True, ensure_ascii=False)
    (folder / f"{name}.json").write_text(text + "\n", encoding="utf-8")


def add_arguments(parser: argparse.ArgumentParser, scenes: bool = True) -> None:
    """What every benchmark takes: ``--short``, ``--no-write`` and, with `scenes`, ``--scenes``."""
    parser.add_argument("--short", action="store_true", help="little of it, on the example scene of this repository")
    parser.add_argument("--no-write", action="store_true", help="print the tables; JSON goes to build/bench/ only")
    if scenes:
        parser.add_argument("--scenes", nargs="+", metavar="NAME", help="scenes to measure [default: all it is about]")


def machine() -> str:
    """What the times were measured on."""
    model = platform.processor() or platform.machine()
    if Path("/proc/cpuinfo").exists():
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        model = next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), model)
    packages = ", ".join(f"{name} {version(name)}" for name in ("numpy", "torch", "numba"))
    return f"{os.cpu_count()} cores of {model}, Python {platform.python_version()}, {packages}"


def table(head: Sequence[str], rows: Sequence[Sequence[str]], text_columns: int = 1) -> str:
    """A Markdown table; all but the first `text_columns` columns are aligned right."""
    rule = ["---" if k < text_columns else "--:" for k in range(len(head))]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (head, rule, *rows)) + "\n"


def replace_section(name: str, text: str, page: Path = PAGE) -> None:
    """Put `text` between the markers ``<!-- NAME:begin -->`` and ``<!-- NAME:end -->`` of a page.

    Raises:
        ValueError: the page lacks them.
    """
    begin, end = f"<!-- {name}:begin -->", f"<!-- {name}:end -->"
    content = page.read_text(encoding="utf-8")
    if content.count(begin) != 1 or content.count(end) != 1:
        raise ValueError(f"{page} needs exactly one {begin} and one {end}")
    before, rest = content.split(begin)
    page.write_text(f"{before}{begin}\n{text.strip()}\n{end}{rest.split(end)[1]}", encoding="utf-8")
