"""Tables of the viewer page in a real browser."""

from __future__ import annotations

from typing import Any

from benchmarks.report import table

COLUMNS = {
    "front": "front",
    "first": "first tile",
    "complete": "first complete picture",
    "30 dB": "30 dB",
    "35 dB": "35 dB",
    "all": "all of it",
}
"""Figures in seconds, by the name of a column."""


def tables(results: dict[str, Any]) -> str:
    """Times of each condition, then memory."""
    timed = {name: record for name, record in results.items() if "median" in record}
    bounded = {name: record for name, record in results.items() if "most" in record}
    head = ["page", *(f"{name}, s" for name in COLUMNS.values()), "longest task, ms", "memory, MB"]
    text = table(head, [row for name, record in timed.items() for row in _rows(name, record)])
    about = ["scene and budget, MB", "file, MB", "most memory, MB", "Gaussians shown", "tiles taken away"]
    return text + "\n" + table(about, [_bounded(name, record) for name, record in bounded.items()])


def _rows(name: str, record: dict[str, Any]) -> list[list[str]]:
    rows = [[name, *_cells(record["median"])]]
    if record["runs"] > 1:
        rows[0][0] += f", median of {record['runs']}"
        rows.append([f"{name}, least", *_cells(record["least"])])
    return rows


def _cells(found: dict[str, float | None]) -> list[str]:
    seconds = [_number(found[key], 2) for key in COLUMNS]
    return [*seconds, _number(found["task"], 0), _number(found["memory"], 0)]


def _number(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def _bounded(name: str, record: dict[str, Any]) -> list[str]:
    megabytes = [f"{record['bytes'] / 1e6:.1f}", f"{record['most']:.1f}"]
    return [name, *megabytes, f"{record['splats']:,}", str(record["evictions"])]
