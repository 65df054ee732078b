"""Results as JSON beside the programs, and as tables between markers of a page."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.provenance import Document, figures, stamp, statement
from benchmarks.scenes import REPOSITORY

RESULTS = REPOSITORY / "benchmarks" / "results"
RESULTS_PAGE, COSTS_PAGE = REPOSITORY / "docs" / "results.md", REPOSITORY / "docs" / "costs.md"
# Encoded files, kept between commands; not part of the repository.
SCRATCH = REPOSITORY / "build" / "benchmarks"
# Results of runs that keep nothing.
SHORT_RESULTS = REPOSITORY / "build" / "bench"


_DEPTHS = {"time": 2, "scale": 2, "trained": 2}
"""Benchmarks whose figures are measured one at a time within a section."""


def load_document(name: str, keep: bool = True) -> Document:
    """The file of results of benchmark `name`, provenance included; without `keep` that under build/bench/."""
    path = (RESULTS if keep else SHORT_RESULTS) / f"{name}.json"
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else {}


def load_results(name: str) -> dict[str, Any]:
    """Earlier results of benchmark `name`; scenes can be measured one at a time and are merged."""
    return figures(load_document(name))


def add_provenance(text: str, name: str, keep: bool = True, section: str = "") -> str:
    """Tables of benchmark `name`, and below them when, at which commit and on which machine they were measured."""
    return f"{text.rstrip()}\n\n{statement(load_document(name, keep), section)}"


def save_results(
    name: str, results: dict[str, Any], keep: bool = True, measured: Collection[str] | None = None
) -> None:
    """Keep the results of benchmark `name` in their order, with the runs that measured them.

    Args:
        keep: among the results of the repository; else only under build/bench/, for a look at them.
        measured: names this run has measured last, SECTION/NAME where there are sections; None for all.
    """
    folder = RESULTS if keep else SHORT_RESULTS
    folder.mkdir(parents=True, exist_ok=True)
    document = stamp(results, load_document(name, keep), measured, _DEPTHS.get(name, 1))
    text = json.dumps(document, indent=1, ensure_ascii=False)
    (folder / f"{name}.json").write_text(text + "\n", encoding="utf-8")


def make_parser(description: str | None, scenes: bool = True, report: bool = True) -> argparse.ArgumentParser:
    """The options of every benchmark: ``--short``, ``--no-write``, perhaps ``--scenes`` and ``--report``."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help="a short run on the example scene of this repository")
    parser.add_argument("--no-write", action="store_true", help="print the tables; JSON goes to build/bench/ only")
    if scenes:
        parser.add_argument("--scenes", nargs="+", metavar="NAME", help="scenes to measure [default: all]")
    if report:
        parser.add_argument("--report", action="store_true", help="measure nothing, rewrite pages from earlier results")
    return parser


def table(head: Sequence[str], rows: Sequence[Sequence[str]], text_columns: int = 1) -> str:
    """A Markdown table; all but the first `text_columns` columns are aligned right."""
    rule = ["---" if k < text_columns else "--:" for k in range(len(head))]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (head, rule, *rows)) + "\n"


def replace_section(name: str, text: str, page: Path) -> None:
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


def publish(
    name: str, results: Mapping[str, Any], makers: Mapping[str, Callable[[Any], str]], keep: bool, kept: bool
) -> None:
    """Put the tables of a benchmark's sections between the markers NAME-SECTION of docs/costs.md.

    Args:
        results: by section; those without any are left alone.
        makers: by section, what makes Markdown of them.
        keep: else print them.
        kept: whether the results are those of the repository.
    """
    for section, make in makers.items():
        if results.get(section):
            text = add_provenance(make(results[section]), name, kept, f"{section}/")
            if keep:
                replace_section(f"{name}-{section}", text, COSTS_PAGE)
            else:
                print(f"{name}-{section}\n\n{text}\n")
