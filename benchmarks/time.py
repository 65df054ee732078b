"""Time and memory: decoding by layers, encoding by effort, and the time to a picture against rivals.

    python -m benchmarks.time                              all sections, an hour or more
    python -m benchmarks.time --sections layers --scenes flowers
    python -m benchmarks.time --short --no-write           the example scene at effort 1, printed
    python -m benchmarks.time --report                     only rewrite tables and plots

Every figure comes from a process of its own; what is compared takes turns. Rivals' settings are those that
`benchmarks.rivals` found best, read from its results. Results are merged into benchmarks/results/time.json; tables and
plots are in docs/costs.md.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

from benchmarks import child
from benchmarks.encode_cache import encode_scene
from benchmarks.judge import interpolate_bytes, smallest
from benchmarks.plots import line, new_plot, save_plot
from benchmarks.quality import measure_layers
from benchmarks.report import (
    COSTS_PAGE,
    add_arguments,
    add_provenance,
    load_results,
    publish,
    save_results,
    table,
)
from benchmarks.rivals import NAME as RIVALS
from benchmarks.rivals import source_ply, write_rival
from benchmarks.rivals_formats import Format, list_formats, list_readers, make_reader
from benchmarks.rivals_tools import ToolFailed, install, install_readers, splat_transform
from benchmarks.scenes import Scene, select_scenes
from scarfmt.api import decode_scene
from scarfmt.cli.scenes import load_subject

NAME = "time"
QUALITIES, EFFORT, ROUNDS = (41.0, 47.0), 1, 2
SHORT_SCENES, SHORT_QUALITIES = ("plush-toys",), (45.0, 47.0)
SCENES = ("plush-toys", "plush-on-bed", "flowers")
PICTURE_QUALITIES = {"flowers": 41.0, "plush-dog": 41.0, "biker": 41.0}
"""Qualities asked for, by scene, so that the judged views have about 41 dB: the encoder uses other views."""
THREADS = (1, 2)
FIRST, GOOD = GOALS = (25.0, 41.0)
"""A first picture and a good one: mean PSNR over the judged views, dB."""
FAMILIES = {"spz": "SPZ", "sog": "SOG", "compressed-ply": "compressed.ply"}
SCAR = "scar"
CORES = {"one": 1, "all": os.cpu_count() or 1}
READ_RUNS, READ_SECONDS = 5, 3.0
SLOW_SECONDS = 600.0
"""A SOG that took longer to write is timed with one iteration of k-means: a file of the same size and structure."""

Record = dict[str, Any]


# Decoding by layers, encoding by effort


def measure_decoding(scene: Scene, short: bool) -> dict[str, Record]:
    """Bytes, error and decode time of the first layer, the first two, and so on, at each quality."""
    found = {}
    for quality in SHORT_QUALITIES[:1] if short else QUALITIES:
        path = encode_scene(scene, quality, EFFORT)["path"]
        layers = measure_layers(scene, Path(path))["layers"]
        jobs: dict[str, child.Job] = {
            f"{number} {threads}": {"job": "decode", "file": path, "threads": threads, "layers": number}
            for number in range(1, len(layers) + 1)
            for threads in THREADS
        }
        times = child.run_in_turns(jobs, 1 if short else ROUNDS)
        rows = [
            {key: layer[key] for key in ("bytes", "psnr_db", "ssim", "anchors")}
            | {"decode": {str(threads): times[f"{number} {threads}"] for threads in THREADS}}
            for number, layer in enumerate(layers, start=1)
        ]
        found[f"{scene.name} q{quality:g}"] = {"scene": scene.name, "quality": quality, "layers": rows}
    return found


def measure_efforts(scene: Scene, short: bool) -> dict[str, Record]:
    """Encode time, memory, bytes and error by effort, at two qualities; the first is the one compared at."""
    efforts = (1,) if short else (0, 1, 2)
    runs = []
    for effort in efforts:
        for quality in SHORT_QUALITIES if short else QUALITIES:
            file = encode_scene(scene, quality, effort)
            last = measure_layers(scene, Path(file["path"]))["layers"][-1]
            run = {key: file[key] for key in ("seconds", "peak_bytes", "bytes")}
            runs.append({**run, "effort": effort, "quality": quality, "psnr_db": last["psnr_db"]})
    return {scene.name: {"scene": scene.name, "runs": runs}}


def bytes_at_equal_error(runs: Sequence[Record]) -> tuple[float, dict[int, float]]:
    """PSNR to compare at, dB, and the bytes of each effort there.

    That PSNR is the best of what the efforts reach at their lowest quality, so that every effort has a file on both
    sides and nothing is extrapolated.

    Raises:
        ValueError: an effort does not reach it at any quality.
    """
    curves: dict[int, list[tuple[float, float]]] = {}
    for run in sorted(runs, key=lambda run: float(run["psnr_db"])):
        curves.setdefault(run["effort"], []).append((run["psnr_db"], run["bytes"]))
    goal = max(curve[0][0] for curve in curves.values())
    return goal, {effort: _bytes_on(curve, goal) for effort, curve in sorted(curves.items())}


def _bytes_on(curve: Sequence[tuple[float, float]], goal: float) -> float:
    for low, high in pairwise(curve):
        if low[0] <= goal <= high[0]:
            return interpolate_bytes(low, high, goal)
    if curve[0][0] == goal:
        return curve[0][1]
    raise ValueError(f"no two files on both sides of {goal:.2f} dB")


def make_layers_table(records: Sequence[Record]) -> str:
    """Bytes, error, decode seconds and memory of every prefix of layers, at the higher quality."""
    head = ["scene", "quality", "layers", "bytes", "PSNR dB", "1 thread, s", "2 threads, s", "peak MiB"]
    rows = []
    shown = max(record["quality"] for record in records)
    for record in (record for record in records if record["quality"] == shown):
        for number, layer in enumerate(record["layers"], start=1):
            one, two = layer["decode"]["1"], layer["decode"]["2"]
            cells = [record["scene"], f"{record['quality']:g}", str(number), f"{layer['bytes']:,}"]
            cells += [f"{layer['psnr_db']:.2f}", f"{one['median']:.3f}", f"{two['median']:.3f}"]
            rows.append([*cells, _mebibytes(two["peak_bytes"])])
    return table(head, rows)


def make_efforts_table(records: Sequence[Record]) -> str:
    """Encode seconds and memory, and bytes at equal error, by effort."""
    head = ["scene", "effort", "quality", "encode s", "peak MiB", "bytes", "PSNR dB", "bytes at equal PSNR", ""]
    rows = []
    for record in records:
        goal, equal = bytes_at_equal_error(record["runs"])
        base = next(iter(equal.values()))
        seen: set[int] = set()
        for run in record["runs"]:
            effort = run["effort"]
            cells = [record["scene"], str(effort), f"{run['quality']:g}", f"{run['seconds']:.1f}"]
            cells += [_mebibytes(run["peak_bytes"]), f"{run['bytes']:,}", f"{run['psnr_db']:.2f}"]
            change = f"{100 * (equal[effort] / base - 1):+.1f} %"
            rows.append([*cells, *(["", ""] if effort in seen else [f"{equal[effort]:,.0f} at {goal:.2f} dB", change])])
            seen.add(effort)
    return table(head, rows)


def _mebibytes(size: float) -> str:
    return f"{size / 2**20:,.0f}"


# The time to a picture


@dataclass(frozen=True)
class Way:
    """A file, or some layers of one, that shows a picture of some quality.

    Attributes:
        family: `SCAR`, or one of `FAMILIES`.
        name: as tables show it.
        goal: one of `GOALS`, dB.
        size: bytes that must arrive.
        psnr_db: mean over the judged views.
        file: what is read to time it.
        layers: of a `.scar` file, how many; 0 for a rival.
        scale: a rival's scene was enlarged by this much.
        note: what a reader of the table should know.
    """

    family: str
    name: str
    goal: float
    size: int
    psnr_db: float
    file: Path
    layers: int = 0
    scale: float = 1.0
    note: str = ""

    def record(self) -> Record:
        """The record of a file in the results."""
        facts = {"family": self.family, "name": self.name, "goal": self.goal, "bytes": self.size}
        return {**facts, "psnr_db": self.psnr_db, "layers": self.layers, "note": self.note}

    def jobs(self) -> Iterator[tuple[str, str, child.Job]]:
        """(cores, reader, job) for each way to time it."""
        for cores, count in CORES.items():
            for reader in [SCAR] if self.layers else list_readers(self.file):
                job = {"job": "benchmarks.time:read_job", "file": str(self.file), "reader": reader}
                more = {"cores": count, "layers": self.layers, "scale": self.scale}
                yield cores, reader, {**job, **more}


def measure_picture(scene: Scene, short: bool) -> dict[str, Record]:
    """All ways to a picture of a scene, timed in turn."""
    quality, effort = (SHORT_QUALITIES[0], 1) if short else (PICTURE_QUALITIES[scene.name], EFFORT)
    theirs, missing = ([], []) if short else _rival_ways(scene, load_results(RIVALS)[scene.name])
    ways = [*_scar_ways(scene, quality, effort), *theirs]
    times = _time_ways(ways, 1 if short else ROUNDS)
    count = len(load_subject(str(scene.path)).placed)
    facts = {"scene": scene.name, "note": scene.note, "count": count, "quality": quality, "effort": effort}
    rows = [{**way.record(), "decode": _fastest(times[number])} for number, way in enumerate(ways)]
    return {scene.name: {**facts, "ways": rows, "missing": missing}}


def _scar_ways(scene: Scene, quality: float, effort: int) -> list[Way]:
    """The first layers that reach each of `GOALS`, or all layers for the last."""
    path = Path(encode_scene(scene, quality, effort)["path"])
    layers = measure_layers(scene, path)["layers"]
    first = next((number for number, it in enumerate(layers, 1) if it["psnr_db"] >= FIRST), len(layers))
    found = []
    for goal, number in zip(GOALS, (first, len(layers)), strict=True):
        last = layers[number - 1]
        short = f"{last['psnr_db']:.1f} dB, less than the {goal:g} dB of the others"
        note = "" if last["psnr_db"] >= goal else short
        found.append(Way(SCAR, ".scar", goal, last["bytes"], last["psnr_db"], path, number, note=note))
    return found


def _rival_ways(scene: Scene, judged: Record) -> tuple[list[Way], list[str]]:
    """Of each family the smallest file that reaches each goal, and why others are missing."""
    gaussians = load_subject(str(scene.path)).placed
    source, known = source_ply(scene, gaussians), {each.name: each for each in list_formats(gaussians)}
    found, missing = [], []
    for family, name in FAMILIES.items():
        mine = [rival for rival in judged["rivals"] if rival["family"] == family]
        for goal in GOALS:
            rival = smallest(mine, goal)
            if rival is None:
                missing.append(f"{scene.name}, {name}: no setting measured reaches {goal:g} dB")
                continue
            way, note = _timed_format(known[rival["name"]], rival)
            try:
                path, _ = write_rival(scene, source, way, False)
            except ToolFailed as error:
                missing.append(f"{scene.name}, {rival['name']}: {error}")
                continue
            facts = goal, rival["bytes"], rival["psnr_db"], path
            found.append(Way(family, rival["name"], *facts, scale=way.scale, note=note))
    return found, missing


def _timed_format(way: Format, judged: Record) -> tuple[Format, str]:
    """The format a rival is timed with, and a note: its own unless writing takes too long."""
    if way.family != "sog" or judged["encode_seconds"] <= SLOW_SECONDS:
        return way, ""
    quick = replace(way, command=lambda source, out: splat_transform(str(source), "--sh-iterations", "1", str(out)))
    return quick, "timed with a file of one iteration of k-means"


def _time_ways(ways: Sequence[Way], rounds: int) -> dict[int, dict[str, dict[str, Record]]]:
    """By number of a way, cores and reader: its times. A file that is read alike for two ways is timed once."""
    named = [(number, cores, reader, job) for number, way in enumerate(ways) for cores, reader, job in way.jobs()]
    jobs = {json.dumps(job): job for *_, job in named}
    times = child.run_in_turns(jobs, rounds)
    found: dict[int, dict[str, dict[str, Record]]] = {}
    for number, cores, reader, job in named:
        found.setdefault(number, {}).setdefault(cores, {})[reader] = times[json.dumps(job)]
    return found


def _fastest(times: Mapping[str, Mapping[str, Record]]) -> dict[str, Record]:
    """By cores the times of the fastest reader, and which that is."""
    found = {}
    for cores, by_reader in times.items():
        reader = min(by_reader, key=lambda name: float(by_reader[name]["min"]))
        found[cores] = {**by_reader[reader], "reader": reader}
    return found


def read_job(job: Record) -> Record:
    """Child job: time a reader on one core or all, after one read that is not counted."""
    if job["cores"] == 1 and hasattr(os, "sched_setaffinity"):
        # Whatever threads a reader starts share that core.
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    path = Path(job["file"])
    if job["reader"] == SCAR:
        act: Callable[[], object] = partial(decode_scene, path, threads=job["cores"], layers=job["layers"])
    else:
        act = make_reader(path, job["scale"], job["reader"])
    act()
    return child.time_calls(act, READ_RUNS, READ_SECONDS)


def seconds_to_picture(way: Record, cores: str, mbit: float) -> float:
    """Transfer, then decoding, the median of its runs: neither waits for parts of the other."""
    return float(way["bytes"] * 8 / (mbit * 1e6) + way["decode"][cores]["median"])


def bandwidths_won(mine: Record, other: Record, cores: str) -> tuple[float, float] | None:
    """Between which bandwidths, Mbit/s, the picture of `mine` is there first; None if nowhere."""
    megabits = (mine["bytes"] - other["bytes"]) * 8 / 1e6
    seconds = mine["decode"][cores]["median"] - other["decode"][cores]["median"]
    if megabits <= 0 and seconds <= 0:
        return 0.0, math.inf
    if megabits >= 0 and seconds >= 0:
        return None
    crossing = -megabits / seconds
    return (0.0, crossing) if megabits < 0 else (crossing, math.inf)


def format_span(span: tuple[float, float] | None) -> str:
    """Bandwidths in words."""
    if span is None:
        return "nowhere"
    low, high = span
    if low == 0 and high == math.inf:
        return "everywhere"
    return f"below {high:,.0f}" if low == 0 else f"above {low:,.0f}"


def make_picture_tables(records: Sequence[Record]) -> str:
    """At which bandwidths `.scar` shows its picture first."""
    head = ["scene", "picture", *(f"{name}, {cores}" for name in FAMILIES.values() for cores in CORES)]
    rows = [
        [record["scene"], f"{mine['goal']:g} dB", *_won_cells(record, mine)]
        for record in records
        for mine in record["ways"]
        if mine["family"] == SCAR
    ]
    text = f"Bandwidths, Mbit/s, at which `.scar` shows the picture first:\n\n{table(head, rows, 2)}"
    notes = {note for record in records for note in record["missing"]}
    for record in records:
        notes |= {f"{record['scene']}, {way['name']}: {way['note']}" for way in record["ways"] if way["note"]}
    return "\n\n".join([text, *(f"{note}." for note in sorted(notes))])


def _won_cells(record: Record, mine: Record) -> list[str]:
    cells = []
    for family in FAMILIES:
        there = [way for way in record["ways"] if way["family"] == family and way["goal"] == mine["goal"]]
        cells += [format_span(bandwidths_won(mine, there[0], cores)) if there else "" for cores in CORES]
    return cells


# The plot and the command


def draw_plot(records: Sequence[Record], keep: bool) -> None:
    """PSNR against decode seconds."""
    figure, axes = new_plot("decode to arrays, s, 2 threads", "PSNR, dB", log_x=True)
    for number, record in enumerate(records):
        xs = [layer["decode"]["2"]["median"] for layer in record["layers"]]
        ys = [layer["psnr_db"] for layer in record["layers"]]
        line(axes, xs, ys, f"{record['scene']}, quality {record['quality']:g}", number)
    save_plot(figure, "time-decode", keep)


SECTIONS = {
    "layers": (SCENES, measure_decoding, make_layers_table),
    "efforts": (SCENES, measure_efforts, make_efforts_table),
    "picture": (tuple(PICTURE_QUALITIES), measure_picture, make_picture_tables),
}
"""Parts of the page: scenes measured unless some are named, how one is measured, and what makes Markdown of records."""


def make_tables(results: dict[str, dict[str, Record]], keep: bool) -> dict[str, str]:
    """The text of each section of docs/costs.md, by the name of its markers."""
    found = {}
    for name, (_, _, make) in SECTIONS.items():
        if results.get(name):
            text = make(list(results[name].values()))
            found[f"{NAME}-{name}"] = add_provenance(text, NAME, keep, f"{name}/")
    return found


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    parser.add_argument("--sections", nargs="+", choices=SECTIONS, default=list(SECTIONS))
    parser.add_argument("--report", action="store_true", help="measure nothing, rewrite tables and plots")
    arguments = parser.parse_args()
    keep, short = not arguments.no_write, arguments.short
    results = load_results(NAME) if keep or arguments.report else {}
    if not (short or arguments.report):
        for note in filter(None, (install(), install_readers())):
            print(note, file=sys.stderr)
    for name in [] if arguments.report else arguments.sections:
        scenes, measure_scene, _ = SECTIONS[name]
        for scene in select_scenes(arguments.scenes or (SHORT_SCENES if short else scenes)):
            began = time.perf_counter()
            found = measure_scene(scene, short)
            results.setdefault(name, {}).update(found)
            save_results(NAME, results, keep, [f"{name}/{below}" for below in found])
            print(f"{time.perf_counter() - began:5.0f} s  {name}, {scene.name}", file=sys.stderr, flush=True)
    if results.get("layers"):
        draw_plot(list(results["layers"].values()), keep)
    publish(make_tables(results, keep or arguments.report), COSTS_PAGE, keep)


if __name__ == "__main__":
    main()
