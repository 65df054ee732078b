"""Time to a picture against bandwidth: transfer and decoding, of `.scar`, SPZ, SOG and compressed.ply.

    python -m benchmarks.time_to_picture                              all scenes; a quarter of an hour, files kept
    python -m benchmarks.time_to_picture --short --no-write           the example scene at effort 1, printed
    python -m benchmarks.time_to_picture --scenes flowers --families spz
    python -m benchmarks.time_to_picture --report                     only rewrite tables and plots

Every reader runs in processes of its own, all in turn. Settings of rivals are chosen by what `benchmarks.rivals_run`
found of them; their files are kept and written as there. Results are merged into
benchmarks/results/time-to-picture.json; tables and plots are in docs/time-to-picture.md.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks import child
from benchmarks.report import add_arguments, load_results, save_results
from benchmarks.rivals_read import GSPLY
from benchmarks.rivals_report import NAME as RIVALS
from benchmarks.rivals_tools import PYTHON, install, install_readers
from benchmarks.scenes import REPOSITORY, Scene, chosen
from benchmarks.time_to_picture_files import FAMILIES, SCAR, SETTINGS, Way, ours, reader_name, rivals
from benchmarks.time_to_picture_plots import draw
from benchmarks.time_to_picture_tables import NAME, tables, write_page

QUALITIES = {"flowers": 41.0, "plush-on-bed": 44.0, "plush-dog": 41.0, "plush-toys": 42.0, "biker": 41.0}
"""Asked for, by scene, so that the judged views have 41 dB: the encoder looks from others."""
EFFORT, ROUNDS = 2, 2
SHORT_QUALITIES, SHORT_FAMILIES, SHORT_SETTINGS = {"plush-toys": 45.0}, ("spz", "compressed-ply"), ("default",)
Record = dict[str, Any]


def measure(scene: Scene, judged: Record, families: Sequence[str], settings: Sequence[str], short: bool) -> Record:
    """All ways to a picture of a scene, timed in turn."""
    quality, effort = (SHORT_QUALITIES[scene.name], 1) if short else (QUALITIES[scene.name], EFFORT)
    mine = ours(scene, quality, effort, settings)
    theirs, missing = rivals(scene, judged, families)
    absent = [f".scar, {name}" for name in SETTINGS if name not in settings]
    absent += [title for family, title in FAMILIES.items() if family not in families]
    missing += [f"{scene.name}, {name}: not measured" for name in absent]
    times = timed([*mine, *theirs], 1 if short else ROUNDS)
    return {
        "scene": scene.name,
        "note": scene.note,
        "count": judged["count"],
        "quality": quality,
        "effort": effort,
        "ways": [{**way.record(), "decode": fastest(times[number])} for number, way in enumerate((*mine, *theirs))],
        "missing": missing,
        "start": start_up([*mine, *theirs]),
    }


def timed(ways: Sequence[Way], rounds: int) -> dict[int, dict[str, dict[str, Record]]]:
    """By number of a way, cores and reader: its times. What is the same file read alike is measured once."""
    named = [(number, cores, reader, job) for number, way in enumerate(ways) for cores, reader, job in way.jobs()]
    jobs = {json.dumps(job): job for *_, job in named}
    times = child.in_turns(jobs, rounds)
    found: dict[int, dict[str, dict[str, Record]]] = {}
    for number, cores, reader, job in named:
        found.setdefault(number, {}).setdefault(cores, {})[reader] = times[json.dumps(job)]
    return found


def fastest(times: Mapping[str, Mapping[str, Record]]) -> dict[str, Record]:
    """By cores the times of the fastest reader, and which that is."""
    found = {}
    for cores, by_reader in times.items():
        reader = min(by_reader, key=lambda name: float(by_reader[name]["min"]))
        found[cores] = {**by_reader[reader], "reader": reader_name(reader)}
    return found


def start_up(ways: Sequence[Way]) -> dict[str, Record]:
    """The start-up of a process that reads one file: seconds of `benchmarks.start_up`, least of several, by reader."""
    first = {SCAR: next(way.file for way in ways if way.family == SCAR)}
    spz = [way.file for way in ways if way.family == "spz"]
    if spz and (PYTHON / "gsply").exists():
        first[GSPLY] = spz[0]
    found = {}
    for name, path in first.items():
        command = [sys.executable, "-m", "benchmarks.start_up", name, str(path), str(PYTHON)]
        runs = [subprocess.run(command, cwd=REPOSITORY, stdout=subprocess.PIPE, check=True) for _ in range(ROUNDS)]
        reports = [json.loads(run.stdout) for run in runs]
        found[name] = {key: min(report[key] for report in reports) for key in reports[0]}
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    parser.add_argument("--families", nargs="*", choices=FAMILIES, help="rivals [default: all]")
    parser.add_argument("--settings", nargs="+", choices=SETTINGS, help="settings of .scar files [default: all]")
    parser.add_argument("--report", action="store_true", help="measure nothing, rewrite tables and plots")
    arguments = parser.parse_args()
    keep, short = not arguments.no_write, arguments.short
    families = list(SHORT_FAMILIES if short else FAMILIES) if arguments.families is None else arguments.families
    settings = arguments.settings or (SHORT_SETTINGS if short else list(SETTINGS))
    results, judged = load_results(NAME) if keep else {}, load_results(RIVALS)
    for note in filter(None, () if arguments.report else (install(), install_readers())):
        print(note, file=sys.stderr)
    names = arguments.scenes or (SHORT_QUALITIES if short else QUALITIES)
    for scene in () if arguments.report else chosen(list(names)):
        print(scene.name, file=sys.stderr, flush=True)
        results[scene.name] = measure(scene, judged[scene.name], families, settings, short)
        save_results(NAME, results, keep, [scene.name])
    records = [results[name] for name in QUALITIES if name in results]
    draw(records, keep)
    if keep:
        write_page(records)
    else:
        print(tables(records))


if __name__ == "__main__":
    main()
