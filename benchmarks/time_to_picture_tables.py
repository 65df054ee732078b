"""The tables of docs/time-to-picture.md, and at which bandwidths one way to a picture is sooner than another."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from benchmarks.report import dated, replace_section, table
from benchmarks.scenes import REPOSITORY
from benchmarks.time_to_picture_files import CORES, FAMILIES, GOALS, GOOD, SCAR, reader_name

NAME = "time-to-picture"
PAGE = REPOSITORY / "docs" / "time-to-picture.md"
BANDWIDTHS = (1, 10, 20, 50, 100, 500, 1000)
"""Mbit/s."""
Record = dict[str, Any]


def title(way: Record) -> str:
    """Whose file, at which setting."""
    return f".scar, {way['name']}" if way["family"] == SCAR else str(way["name"])


def seconds_to(way: Record, cores: str, mbit: float) -> float:
    """Transfer, then decoding, the median of its runs: neither waits for parts of the other."""
    return float(way["bytes"] * 8 / (mbit * 1e6) + way["decode"][cores]["median"])


def sooner(mine: Record, other: Record, cores: str) -> tuple[float, float] | None:
    """Between which bandwidths, Mbit/s, the picture of `mine` is there first; None if nowhere."""
    megabits = (mine["bytes"] - other["bytes"]) * 8 / 1e6
    seconds = mine["decode"][cores]["median"] - other["decode"][cores]["median"]
    if megabits <= 0 and seconds <= 0:
        return 0.0, math.inf
    if megabits >= 0 and seconds >= 0:
        return None
    crossing = -megabits / seconds
    return (0.0, crossing) if megabits < 0 else (crossing, math.inf)


def span_text(span: tuple[float, float] | None) -> str:
    """Bandwidths in words."""
    if span is None:
        return "nowhere"
    low, high = span
    if low == 0 and high == math.inf:
        return "everywhere"
    return f"below {high:,.0f}" if low == 0 else f"above {low:,.0f}"


def tables(records: Sequence[Record]) -> str:
    """Everything the page gets, as text."""
    return "\n\n".join(make(records) for make in (crossings, times, start_up))


def write_page(records: Sequence[Record]) -> None:
    """Put all tables into docs/time-to-picture.md."""
    for section, make in (("crossings", crossings), ("times", times), ("start-up", start_up)):
        replace_section(f"picture-{section}", dated(make(records), NAME), PAGE)


def crossings(records: Sequence[Record]) -> str:
    """Below which bandwidths ours is sooner: a row for each setting of ours and goal."""
    cells = [f"{name}, {cores}" for name in FAMILIES.values() for cores in CORES]
    rows = []
    for record in records:
        for mine in (way for way in record["ways"] if way["family"] == SCAR):
            short = f" (only {mine['psnr_db']:.1f} dB)" if mine["psnr_db"] < mine["goal"] else ""
            row = [record["scene"], f"{mine['goal']:g} dB", title(mine) + short]
            for family in FAMILIES:
                there = [w for w in record["ways"] if w["family"] == family and w["goal"] == mine["goal"]]
                row += [span_text(sooner(mine, there[0], cores)) if there else "" for cores in CORES]
            rows.append(row)
    return table(["scene", "picture", "ours", *cells], rows, 3)


def times(records: Sequence[Record]) -> str:
    """Seconds to the picture of every way, by bandwidth."""
    return "\n\n".join(_scene(record) for record in records)


def _scene(record: Record) -> str:
    head = ["picture", "file", "bytes", "dB", "read by", "decode one core, s", "all", *_columns()]
    rows = []
    for goal in GOALS:
        for way in (way for way in record["ways"] if way["goal"] == goal):
            one, many = (way["decode"][cores] for cores in CORES)
            told = [f"{goal:g} dB", title(way) + _layers(way), f"{way['bytes']:,}", f"{way['psnr_db']:.1f}"]
            medians = [f"{times['median']:.3f} ({times['min']:.3f})" for times in (one, many)]
            rows.append([*told, one["reader"], *medians, *(_both(way, mbit) for mbit in BANDWIDTHS)])
    notes = {f"{record['scene']}, {title(way)}: {way['note']}" for way in record["ways"] if way["note"]} | set(
        record["missing"]
    )
    text = f"### {record['scene']}\n\n{record['note']}; {record['count']:,} Gaussians; ours asked for quality"
    plot = f"![Seconds against bandwidth](images/{image(record)}.svg)"
    said = "".join(f"\n{note}.\n" for note in sorted(notes))
    return (
        f"{text} {record['quality']:g}, effort {record['effort']}.\n\n{plot}\n\n{table(head, rows, 2)}{said}".rstrip()
    )


def _columns() -> list[str]:
    return [f"{mbit:g} Mbit/s" for mbit in BANDWIDTHS]


def _layers(way: Record) -> str:
    if way["family"] != SCAR:
        return ""
    return ", all layers" if way["goal"] == GOOD else f", {way['layers']} layer{'s' * (way['layers'] > 1)}"


def _both(way: Record, mbit: float) -> str:
    one, many = (_short(seconds_to(way, cores, mbit)) for cores in CORES)
    return one if one == many else f"{one} / {many}"


def _short(seconds: float) -> str:
    return f"{seconds:.1f}" if seconds >= 10 else f"{seconds:.2f}" if seconds >= 0.1 else f"{seconds:.3f}"


def image(record: Record) -> str:
    """Name of a scene's plot."""
    return f"{NAME}-{record['scene']}"


def start_up(records: Sequence[Record]) -> str:
    """The cost of a process before and beside reading."""
    head = ["scene", "reader", "import, s", "first file, s more", "opening a file, s"]
    rows = []
    for record in records:
        for reader, found in record["start"].items():
            opened = f"{found['open']:.4f}" if "open" in found else ""
            cells = [f"{found['import']:.2f}", f"{found['first_more']:.2f}", opened]
            rows.append([record["scene"], reader_name(reader), *cells])
    return table(head, rows, 2)
