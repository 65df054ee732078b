"""Time and memory: decoding by layers, encoding by effort.

    python -m benchmarks.time                              all sections, an hour or more
    python -m benchmarks.time --sections layers --scenes flowers
    python -m benchmarks.time --short --no-write           the example scene at effort 1, printed
    python -m benchmarks.time --report                     only rewrite tables and plots

Every figure comes from a process of its own; what is compared takes turns. Results are merged into
benchmarks/results/time.json; tables and plots are in docs/costs.md.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks import child
from benchmarks.encode_cache import encode_scene
from benchmarks.judge import bytes_at
from benchmarks.plots import line, new_plot, save_plot
from benchmarks.quality import measure_layers
from benchmarks.report import load_results, make_parser, publish, save_results, table
from benchmarks.scenes import Scene, select_scenes

NAME = "time"
QUALITIES, EFFORT, ROUNDS = (41.0, 47.0), 1, 2
SHORT_SCENES, SHORT_QUALITIES = ("plush-toys",), (45.0, 47.0)
SCENES = ("plush-toys", "plush-on-bed", "flowers")
THREADS = (1, 2)

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
    goal, found = max(curve[0][0] for curve in curves.values()), {}
    for effort, curve in sorted(curves.items()):
        size = bytes_at(curve, goal)
        if size is None:
            raise ValueError(f"no two files on both sides of {goal:.2f} dB")
        found[effort] = size
    return goal, found


def make_layers_table(results: Mapping[str, Record]) -> str:
    """Bytes, error, decode seconds and memory of every prefix of layers, at the higher quality."""
    head = ["scene", "quality", "layers", "bytes", "PSNR dB", "1 thread, s", "2 threads, s", "peak MiB"]
    rows = []
    shown = max(record["quality"] for record in results.values())
    for record in (record for record in results.values() if record["quality"] == shown):
        for number, layer in enumerate(record["layers"], start=1):
            one, two = layer["decode"]["1"], layer["decode"]["2"]
            cells = [record["scene"], f"{record['quality']:g}", str(number), f"{layer['bytes']:,}"]
            cells += [f"{layer['psnr_db']:.2f}", f"{one['median']:.3f}", f"{two['median']:.3f}"]
            rows.append([*cells, _mebibytes(two["peak_bytes"])])
    return table(head, rows)


def make_efforts_table(results: Mapping[str, Record]) -> str:
    """Encode seconds and memory, and bytes at equal error, by effort."""
    head = ["scene", "effort", "quality", "encode s", "peak MiB", "bytes", "PSNR dB", "bytes at equal PSNR", ""]
    rows = []
    for record in results.values():
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


# The plot and the command


def draw_plot(records: Sequence[Record], keep: bool) -> None:
    """PSNR against decode seconds."""
    figure, axes = new_plot("decode to arrays, s, 2 threads", "PSNR, dB", log_x=True)
    for number, record in enumerate(records):
        xs = [layer["decode"]["2"]["median"] for layer in record["layers"]]
        ys = [layer["psnr_db"] for layer in record["layers"]]
        line(axes, xs, ys, f"{record['scene']}, quality {record['quality']:g}", number)
    save_plot(figure, "time-decode", keep)


SECTIONS = {"layers": measure_decoding, "efforts": measure_efforts}
"""Parts of the page: how a scene is measured."""
TABLES = {"layers": make_layers_table, "efforts": make_efforts_table}


def main() -> None:
    """The command line."""
    parser = make_parser(__doc__)
    parser.add_argument("--sections", nargs="+", choices=SECTIONS, default=list(SECTIONS))
    arguments = parser.parse_args()
    keep, short = not arguments.no_write, arguments.short
    results = load_results(NAME) if keep or arguments.report else {}
    for name in [] if arguments.report else arguments.sections:
        for scene in select_scenes(arguments.scenes or (SHORT_SCENES if short else SCENES)):
            began = time.perf_counter()
            found = SECTIONS[name](scene, short)
            results.setdefault(name, {}).update(found)
            save_results(NAME, results, keep, [f"{name}/{below}" for below in found])
            print(f"{time.perf_counter() - began:5.0f} s  {name}, {scene.name}", file=sys.stderr, flush=True)
    if results.get("layers"):
        draw_plot(list(results["layers"].values()), keep)
    publish(NAME, results, TABLES, keep, keep or arguments.report)


if __name__ == "__main__":
    main()
