"""Time and memory against the number of Gaussians, from 10 thousand to 10 million.

    python -m benchmarks.scaling                            flowers: about fifteen minutes
    python -m benchmarks.scaling --short --no-write         the example scene and 4 copies of it, printed

Scenes are the Gaussians nearest to the middle of one real scene; larger ones are copies of what the whole was encoded
to, laid side by side with jitter (`benchmarks.scaling_scenes.copies`) and coded by the writer: no encoder ran on them.
Every figure comes from a process of its own. Slopes are those of lines through log time and log anchors.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import child
from benchmarks.encoded import kept_path
from benchmarks.plots import line, new_plot, save_plot
from benchmarks.report import add_arguments, dated, load_results, replace_section, save_results, table
from benchmarks.scenes import REPOSITORY, Scene, chosen

NAME = "scaling"
PAGE = REPOSITORY / "docs" / "scaling.md"
QUALITY = 41.0
JOBS = "benchmarks.scaling_jobs"
CODED = ("static", "neural")
MOST_IN_ARRAYS = 4_000_000
"""Above, a scene is only decoded tile by tile."""
MOST_NEURAL_COPIES = 6
"""Maximum copies that are written with networks. More are written under static tables alone: the writer evaluates the
networks for every anchor."""
_LARGE = 100_000
"""Slopes of large scenes are from here on: below, starting up counts."""


@dataclass(frozen=True)
class Plan:
    """The plan of the measurements.

    Attributes:
        scene: name of the scene.
        counts: Gaussians to encode; None for all.
        copies: how many times the last of them is laid side by side.
        efforts: of encoding; the last makes the files that are decoded.
    """

    scene: str
    counts: tuple[int | None, ...]
    copies: tuple[int, ...]
    efforts: tuple[int, ...]


FULL = Plan("flowers", (10_000, 30_000, 100_000, 300_000, None), (2, 6, 20), (1, 2))
SHORT = Plan("plush-toys", (3_000, None), (4,), (1,))


def measure(plan: Plan, kept: dict[str, Any], keep: Callable[[dict[str, Any]], None]) -> None:
    """All sizes of a plan; each is added to `kept` and given to `keep` as soon as it is there."""
    scene = chosen([plan.scene])[0]
    for count in plan.counts:
        files, run = _encoded(scene, count, plan.efforts)
        _finish(scene, run, files, kept, keep)
    for number in plan.copies:
        copied, run = _copied(scene, files, number)
        _finish(scene, run, copied, kept, keep)
        for path in copied.values():
            Path(path).unlink()


def _finish(
    scene: Scene,
    run: dict[str, Any],
    files: dict[str, str],
    kept: dict[str, Any],
    keep: Callable[[dict[str, Any]], None],
) -> None:
    decoded = {coded: _decoded(path, run["anchors"]) for coded, path in files.items()}
    kept[f"{scene.name} {run['source_count']:09d}"] = {"scene": scene.name, **run, **decoded}
    keep(kept)


def _encoded(scene: Scene, count: int | None, efforts: Sequence[int]) -> tuple[dict[str, str], dict[str, Any]]:
    """Some of a scene at each effort: the last file, with networks and without, and what encoding took."""
    took: dict[str, Any] = {}
    for effort in efforts:
        print(f"{scene.name}: encode {count or 'all'} at effort {effort}", file=sys.stderr)
        path = kept_path(scene, f"scaling-q{QUALITY:g}-e{effort}-n{count}")
        took[str(effort)] = child.run(
            job=f"{JOBS}:encode", scene=scene.name, count=count, quality=QUALITY, effort=effort, out=str(path)
        )
    plain = str(path.with_suffix(".static.scar"))
    facts = child.run(job=f"{JOBS}:rewrite", file=str(path), static=True, out=plain)
    run = {"source_count": facts["source_count"], "anchors": facts["anchors"], "encode": took}
    # Effort 1 makes no networks: both would be the same file.
    return {"static": plain} if efforts[-1] == 1 else {"static": plain, "neural": str(path)}, run


def _copied(scene: Scene, files: dict[str, str], number: int) -> tuple[dict[str, str], dict[str, Any]]:
    """Files of `number` copies, and what writing them took."""
    out: dict[str, str] = {}
    took: dict[str, Any] = {}
    for coded, path in files.items():
        if coded == "neural" and number > MOST_NEURAL_COPIES:
            continue
        print(f"{scene.name}: write {number} copies, {coded}", file=sys.stderr)
        out[coded] = str(Path(path).with_suffix(f".x{number}.scar"))
        took[coded] = child.run(job=f"{JOBS}:rewrite", file=path, copies=number, out=out[coded])
    facts = took["static"]
    run = {"source_count": facts["source_count"], "anchors": facts["anchors"], "copies": number, "write": took}
    return out, run


def _decoded(path: str, anchors: int) -> dict[str, Any]:
    """Bytes of a file, and what each way of reading it takes."""
    print(f"decode {Path(path).name}", file=sys.stderr)
    jobs: dict[str, dict[str, Any]] = {
        "stream": {"job": f"{JOBS}:stream"},
        "first": {"job": f"{JOBS}:arrays", "layers": 1},
        "arrays": {"job": f"{JOBS}:arrays"},
    }
    if anchors > MOST_IN_ARRAYS:
        del jobs["arrays"]
    found = child.in_turns({name: {"file": path, **job} for name, job in jobs.items()}, 1)
    return {**found, "inspect": child.run(job="inspect", file=path), "bytes": Path(path).stat().st_size}


def slope(points: Sequence[tuple[float, float]]) -> float:
    """Exponent b of the line y = a * x^b nearest to (x, y) points, by least squares of the logarithms.

    NaN for fewer than two different x.
    """
    if len({x for x, _ in points}) < 2:
        return math.nan
    x, y = np.log(np.array(points, np.float64).T)
    return float(np.polyfit(x, y, 1)[0])


SERIES: dict[str, Callable[[dict[str, Any]], dict[str, Any] | None]] = {
    "encode, effort 1": lambda run: run.get("encode", {}).get("1"),
    "encode, effort 2": lambda run: run.get("encode", {}).get("2"),
    "static, tile by tile": lambda run: run.get("static", {}).get("stream"),
    "neural, tile by tile": lambda run: run.get("neural", {}).get("stream"),
    "static, into arrays": lambda run: run.get("static", {}).get("arrays"),
    "neural, into arrays": lambda run: run.get("neural", {}).get("arrays"),
    "static, first layer": lambda run: run.get("static", {}).get("first"),
    "neural, first layer": lambda run: run.get("neural", {}).get("first"),
}
"""The series that are measured at every size: how to find processor seconds (`cpu`) and `peak_bytes`, or None."""


def points(runs: Sequence[dict[str, Any]], series: str, field: str) -> list[tuple[float, float]]:
    """(anchors, value) of a series where it was measured."""
    found = ((run["anchors"], SERIES[series](run)) for run in runs)
    return [(float(anchors), float(job[field])) for anchors, job in found if job is not None]


def markdown(results: dict[str, Any]) -> str:
    """The tables of the page."""
    parts = []
    for name in sorted({run["scene"] for run in results.values()}):
        runs = sorted((run for run in results.values() if run["scene"] == name), key=lambda run: run["source_count"])
        parts += [f"**{name}**, quality {QUALITY:g}. Seconds are of the processor; MiB is the peak of the process."]
        parts += [_encode_table(runs), _decode_table(runs), _slope_table(runs)]
    return "\n\n".join(parts)


def _encode_table(runs: Sequence[dict[str, Any]]) -> str:
    head = ["Gaussians", "kept", "effort 1 s", "MiB", "effort 2 s", "MiB", "bytes static", "bytes neural"]
    rows = []
    for run in runs:
        costs = [cell for effort in ("1", "2") for cell in _cost(run.get("encode", {}).get(effort))]
        size = f"{run['source_count']:,}{' (copies)' if 'copies' in run else ''}"
        sizes = [f"{run[coded]['bytes']:,}" if coded in run else "-" for coded in CODED]
        rows.append([size, f"{run['anchors']:,}", *costs, *sizes])
    return table(head, rows)


def _decode_table(runs: Sequence[dict[str, Any]]) -> str:
    head = ["Gaussians", "coded", "tile by tile s", "MiB", "arrays s", "MiB", "layer 1 s", "MiB", "inspect ms", "bytes"]
    rows = []
    for coded in CODED:
        for run in runs:
            if coded not in run:
                continue
            found = run[coded]
            costs = [cell for way in ("stream", "arrays", "first") for cell in _cost(found.get(way))]
            told = found["inspect"]
            inspected = [f"{1000 * told['seconds']:.1f}", f"{told['bytes_read']:,}"]
            rows.append([f"{run['source_count']:,}", coded, *costs, *inspected])
    return table(head, rows, 2)


def _slope_table(runs: Sequence[dict[str, Any]]) -> str:
    rows = []
    for series in SERIES:
        every, peaks = points(runs, series, "cpu"), points(runs, series, "peak_bytes")
        large = [point for point in every if point[0] >= _LARGE]
        numbers = [slope(every), slope(large), slope([point for point in peaks if point[0] >= _LARGE])]
        rows.append([series, *("-" if math.isnan(number) else f"{number:.2f}" for number in numbers)])
    return table(["slope of", "time", f"time from {_LARGE:,} on", "memory from there on"], rows)


def _cost(job: dict[str, Any] | None) -> list[str]:
    return ["-", "-"] if job is None else [f"{job['cpu']:.2f}", f"{job['peak_bytes'] / 2**20:,.0f}"]


def plot(results: dict[str, Any], keep: bool) -> None:
    """Time and memory against anchors."""
    runs = sorted(results.values(), key=lambda run: int(run["anchors"]))
    shown = [series for series in SERIES if "arrays" not in series]
    for field, unit, scale in (("cpu", "processor seconds", 1.0), ("peak_bytes", "peak MiB", 2.0**20)):
        figure, axes = new_plot("anchors", unit, log_x=True, log_y=True)
        for number, series in enumerate(shown):
            found = points(runs, series, field)
            if found:
                label = f"{series}: slope {slope(found):.2f}" if field == "cpu" and len(found) > 1 else series
                line(axes, [x for x, _ in found], [y / scale for _, y in found], label, number)
        save_plot(figure, f"scaling-{'time' if field == 'cpu' else 'memory'}", keep)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser, scenes=False)
    parser.add_argument("--report", action="store_true", help="only draw tables and plots again from earlier results")
    arguments = parser.parse_args()
    write = not arguments.no_write
    results = {} if arguments.no_write or not arguments.report else load_results(NAME)
    if not arguments.report:
        measure(SHORT if arguments.short else FULL, results, lambda kept: save_results(NAME, kept, write))
    plot(results, write)
    show = partial(replace_section, NAME, page=PAGE) if write else print
    show(dated(markdown(results), NAME, write))


if __name__ == "__main__":
    main()
