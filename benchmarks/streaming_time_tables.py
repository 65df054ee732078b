"""The tables and plots of `benchmarks.streaming_time`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.plots import COLOURS, new_plot, save_plot
from benchmarks.report import dated, replace_section, table
from benchmarks.scenes import REPOSITORY
from benchmarks.streaming_times import LEVELS_DB, MOMENTS, WATCHED_S

NAME = "streaming-time"
PAGE = REPOSITORY / "docs" / "streaming.md"
OURS, BASE, ORACLE = "planned by gains", "file order", "oracle"
POLICIES = (BASE, "in view first", "nearest first", "planned, nothing told", OURS, ORACLE)
PLOTTED = (OURS, BASE, "streamed SOG", "whole SOG", "whole SPZ", ORACLE)
NETWORK = "10 Mbit/s"
AIM_DB, AIM = 30.0, 0.25
FAST_MBIT = 100.0
"""Bandwidth above which round trips decide."""
_COMPLETE_S = 2.5
"""From then on everything has come on the fastest network."""
_NEVER = "–"

Record = Mapping[str, Any]
Figures = Mapping[str, Any]


def tables(results: Mapping[str, Record]) -> str:
    """Everything the page gets, as text."""
    return "\n\n".join(text for _, text in sections(results) if text)


def sections(results: Mapping[str, Record]) -> list[tuple[str, str]]:
    """Name and text of each section."""
    with_rivals = {name: record for name, record in results.items() if rivals_of(record)}
    return [
        ("streaming-rivals", against(with_rivals) if with_rivals else ""),
        ("streaming-times", times(with_rivals) if with_rivals else ""),
        ("streaming-policies", policies(results)),
    ]


def write_page(results: Mapping[str, Record]) -> None:
    """Put all tables into docs/streaming.md, and draw its plots."""
    for section, text in sections(results):
        replace_section(section, dated(text, NAME), PAGE)
    for name, record in results.items():
        plot(name, record)


def rivals_of(record: Record) -> list[str]:
    """Names of what is no `.scar`."""
    return [name for name in next(iter(record["runs"].values())) if name not in POLICIES]


def against(results: Mapping[str, Record]) -> str:
    """How many times sooner a planned `.scar` file is at each quality than each rival, over all conditions."""
    head = ["scene", "rival", *(f"to {level:g} dB" for level in LEVELS_DB), f"to {AIM_DB:g} dB, slow",
            f"worst to {AIM_DB:g} dB", f"in a quarter, {AIM_DB:g} dB", "slow"]  # fmt: skip
    rows = []
    for scene, record in results.items():
        for rival in rivals_of(record):
            shares = [list(ratios(record, OURS, rival, number)) for number in range(len(LEVELS_DB))]
            aimed = shares[LEVELS_DB.index(AIM_DB)]
            slow = list(ratios(record, OURS, rival, LEVELS_DB.index(AIM_DB), False))
            quarters = [f"{sum(share <= AIM for share in found)} of {len(found)}" for found in (aimed, slow)]
            means = [_times(mean_ratio(found)) for found in (*shares, slow)]
            rows.append([scene, rival, *means, _times(max(aimed)), *quarters])
    return table(head, rows, 2)


def ratios(record: Record, one: str, other: str, level: int, fast: bool | None = None) -> Iterator[float]:
    """In each condition the seconds of `one` to a level, in those of `other`: infinite or 0 where only one gets there.

    Where neither does, 1. With `fast`, only those of networks of more than `FAST_MBIT`, or only the others.
    """
    for condition, row in record["runs"].items():
        mbits = next(mean for name, mean in record["networks"].items() if condition.startswith(f"{name}, "))
        if fast is not None and fast is not (mbits > FAST_MBIT):
            continue
        ours, theirs = row[one]["to"][level], row[other]["to"][level]
        if ours is None:
            yield float("inf") if theirs is not None else 1.0
        else:
            yield 0.0 if theirs is None else ours / theirs


def mean_ratio(found: Sequence[float]) -> float | None:
    """The geometric mean of what both get to; None if there is no condition in which both do."""
    both = [share for share in found if 0 < share < float("inf")]
    return float(np.exp(np.mean(np.log(both)))) if len(both) == len(found) else None


def _times(share: float | None) -> str:
    """A ratio of seconds as how many times sooner."""
    if share is None or share == float("inf"):
        return _NEVER
    return "only ours" if share == 0 else f"{1 / share:.1f}×"


def times(results: Mapping[str, Record]) -> str:
    """Seconds to `AIM_DB` on each network, and what the files are."""
    means = next(iter(results.values()))["networks"]
    networks = sorted(means, key=means.__getitem__)
    head = ["scene", "what", "MB", "dB once all is there"]
    head += [f"s at {means[name]:.3g} Mbit/s" for name in networks]
    head += ["requests", "never looked at"]
    rows = []
    for scene, record in results.items():
        for name in (OURS, BASE, *rivals_of(record)):
            found = [_seconds(record, network, name) for network in networks]
            size = f"{_size(record, name) / 1e6:.2f}"
            rows.append([scene, name, size, f"{final_db(record, name):.1f}", *found, *_traffic(record, name)])
    return table(head, rows, 2)


def _size(record: Record, name: str) -> int:
    return int(record["sizes"]["`.scar`" if name in POLICIES else name])


def final_db(record: Record, name: str) -> float:
    """The PSNR of the views on the fastest network, once everything has arrived."""
    fastest = max(record["networks"], key=lambda network: record["networks"][network])
    curve = record["curves"][fastest][name]
    return float(np.mean([found for seconds, found in zip(MOMENTS, curve, strict=False) if seconds >= _COMPLETE_S]))


def _seconds(record: Record, network: str, name: str) -> str:
    """To `AIM_DB`, mean over round trips and motions; never, if it is not reached in one of them."""
    level = LEVELS_DB.index(AIM_DB)
    rows = (row for condition, row in record["runs"].items() if condition.startswith(f"{network}, "))
    found = [row[name]["to"][level] for row in rows]
    return _NEVER if None in found else f"{np.mean(found):.2f}"


def _traffic(record: Record, name: str) -> list[str]:
    """Requests in the first seconds, and the part of what came in them that is never looked at."""
    rows = [row[name] for row in record["runs"].values()]
    came = sum(row["bytes"] for row in rows)
    unseen = sum(row["unseen"] for row in rows)
    return [f"{np.mean([row['requests'] for row in rows]):.0f}", f"{100 * unseen / max(came, 1):.0f} %"]


def policies(results: Mapping[str, Record]) -> str:
    """The time of each policy relative to file order, mean and worst, and the mean dB; on slow networks."""
    head = ["scene", "order", *(f"{level:g} dB" for level in LEVELS_DB), "worst to 35 dB", "35 dB, fast",
            f"mean dB, {WATCHED_S:g} s", "requests", "never looked at"]  # fmt: skip
    rows = []
    for scene, record in results.items():
        for name in POLICIES:
            shares = [list(ratios(record, name, BASE, number, False)) for number in range(len(LEVELS_DB))]
            fast = list(ratios(record, name, BASE, LEVELS_DB.index(35.0), True))
            mean = np.mean([row[name]["mean"] for row in record["runs"].values()])
            cells = [_change(mean_both(found)) for found in shares]
            cells += [_change(max(shares[LEVELS_DB.index(35.0)])), _change(mean_both(fast))]
            rows.append([scene, name, *cells, f"{mean:.1f}", *_traffic(record, name)])
    return table(head, rows, 2)


def mean_both(found: Sequence[float]) -> float | None:
    """The geometric mean over the conditions in which both get there; None if there is none."""
    both = [share for share in found if 0 < share < float("inf")]
    return float(np.exp(np.mean(np.log(both)))) if both else None


def _change(share: float | None) -> str:
    if share is None or share == float("inf"):
        return _NEVER
    return f"{100 * (share - 1):+.0f} %"


def plot(scene: str, record: Record, keep: bool = True) -> Path | None:
    """dB in view over time on `NETWORK`; None where it was not measured."""
    if NETWORK not in record["curves"]:
        return None
    curves = record["curves"][NETWORK]
    figure, axes = new_plot("s", "dB in view", log_x=True, title=f"{scene}, {NETWORK}")
    for number, name in enumerate(name for name in PLOTTED if name in curves):
        curve = curves[name]
        style = "--" if name == ORACLE else "-"
        axes.plot(MOMENTS[: len(curve)], curve, style, color=COLOURS[number % len(COLOURS)], label=name)
    axes.set_xticks([0.1, 0.2, 0.5, 1, 2, 5, 10], ["0.1", "0.2", "0.5", "1", "2", "5", "10"])
    axes.minorticks_off()
    return save_plot(figure, image(scene), keep)


def image(scene: str) -> str:
    """Name of its plot."""
    words = "".join(letter if letter.isalnum() else " " for letter in scene).split()
    return "-".join(["streaming", *words])
