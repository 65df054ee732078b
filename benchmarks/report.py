"""Results as JSON next to the scripts, and as tables between markers of docs/benchmarks.md."""

from __future__ import annotations

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


def load_results(name: str) -> dict[str, Any]:
    """Earlier results of benchmark `name`; scenes can be measured one at a time and are merged."""
    path = RESULTS / f"{name}.json"
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else {}


def save_results(name: str, results: dict[str, Any]) -> None:
    """Keep the results of benchmark `name`."""
    RESULTS.mkdir(exist_ok=True)
    text = json.dumps(results, indent=1, sort_keys=True, ensure_ascii=False)
    (RESULTS / f"{name}.json").write_text(text + "\n", encoding="utf-8")


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
