"""The tables of docs/mechanisms.md, from the records that `benchmarks.mechanisms` keeps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from benchmarks.report import dated, replace_section, table
from benchmarks.scenes import REPOSITORY

NAME = "mechanisms"
PAGE = REPOSITORY / "docs" / "mechanisms.md"
SCENES = ["plush-toys", "plush-dog", "fruit-drops", "flower-tile", "angel", "massa", "plant", "plush-on-bed"]
"""Measured unless scenes are named."""
STUDIES = ("coding", "deciding")
Record = dict[str, Any]
Point = Sequence[float]


def worth(record: Record) -> float:
    """The growth of the file without a mechanism, as a share of it."""
    if "bytes" in record:
        return float(record["without"]) / float(record["bytes"]) - 1
    return at_equal_pictures(record["own"], record["without"])


def at_equal_pictures(own: Sequence[Point], without: Sequence[Point]) -> float:
    """Relative difference in bytes of two curves of (bytes, dB) through two points, where their middles meet."""
    middle = sum(db for _, db in (*own, *without)) / (len(own) + len(without))
    return math.exp(_log_bytes(without, middle) - _log_bytes(own, middle)) - 1


def _log_bytes(curve: Sequence[Point], db: float) -> float:
    (first, low), (second, high) = curve
    share = (db - low) / (high - low)
    return math.log(first) + share * (math.log(second) - math.log(first))


def texts(results: dict[str, Any]) -> dict[str, str]:
    """Markdown of every study with results."""
    return {study: _table(list(results[study].values())) for study in STUDIES if study in results}


def write_page(results: dict[str, Any]) -> None:
    """Rewrite both tables of the page."""
    for study, text in texts(results).items():
        replace_section(study, dated(text, NAME, section=f"{study}/"), PAGE)


def _table(records: Sequence[Record]) -> str:
    scenes = [scene for scene in SCENES if any(record["scene"] == scene for record in records)]
    rows = []
    for mechanism in dict.fromkeys(record["mechanism"] for record in records):
        mine = {record["scene"]: worth(record) for record in records if record["mechanism"] == mechanism}
        cells = [f"{mine[scene]:+.2%}" if scene in mine else "" for scene in scenes]
        rows.append([mechanism, *cells, f"{max(mine.values()):+.2%}"])
    return table(["without", *scenes, "most"], rows)
