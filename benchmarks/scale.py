"""Time and memory against the number of Gaussians: in memory to a whole scene, in ranges beyond.

    python -m benchmarks.scale                              flowers, 10 and 50 million in ranges: hours
    python -m benchmarks.scale --sections sizes             flowers in memory: about fifteen minutes
    python -m benchmarks.scale --sections ranges --gaussians 10000000 --workers 1 2
    python -m benchmarks.scale --short --no-write           the example scene and copies of it, printed

Scenes of `sizes` are the Gaussians nearest to the middle of one real scene. No real scene of the sizes of `ranges` is
at hand: those are copies of one (:func:`write_copies`), encoded by `scarfmt encode --work`, then decoded. Every
figure comes from a process of its own, in ranges with workers of one thread, watched from outside
(:class:`Watch`). Slopes are those of lines through log time and log Gaussians. Results are merged into
benchmarks/results/scale.json; tables and plots are in docs/costs.md.
"""

from __future__ import annotations

import math
import os
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from benchmarks import child
from benchmarks.encode_cache import cache_path
from benchmarks.plots import line, new_plot, save_plot
from benchmarks.report import SCRATCH, load_results, make_parser, publish, save_results, table
from benchmarks.scenes import REPOSITORY, Scene, select_scenes
from scarfmt.api import inspect
from scarfmt.atomic import atomic_write
from scarfmt.formats import load
from scarfmt.formats.clean import clean
from scarfmt.formats.export_ply import ply_header, ply_rows
from scarfmt.render.camera import core, upward_axes
from scarfmt.scene.gaussians import GaussianScene

NAME, SCENE, SHORT_SCENE = "scale", "flowers", "plush-toys"
QUALITY = 41.0
COUNTS: tuple[int | None, ...] = (10_000, 30_000, 100_000, 300_000, None)
EFFORTS = (1, 2)
SHORT_COUNTS: tuple[int | None, ...] = (3_000, None)
SIZES, SHORT_SIZES = (10_000_000, 50_000_000), (8_000,)
RANGE, SHORT_RANGE = 1_000_000, 2_000
EXECUTORS = ("processes", "dask")
MOST_IN_ARRAYS = 4_000_000
"""Above, a scene is only decoded tile by tile."""
LARGE = 100_000
"""Slopes are taken from here on: below, starting up counts."""

SPACING = 2.4
"""Half extents of the core from copy to copy."""
_JITTER, _SCALE_JITTER, _OPACITY_JITTER, _COLOUR_JITTER, _GAIN = 0.1, 0.05, 0.1, 0.02, 0.3
WATCH_SECONDS = 0.5
"""Between two looks at processes."""

Run = dict[str, Any]
Add = Callable[[str, str, Run], None]
"""Keeps a run: section, name, run."""


# In memory


def measure_sizes(scene: Scene, counts: Sequence[int | None], efforts: Sequence[int], add: Add) -> None:
    """Encode parts of a scene in memory at each effort, and decode the last file."""
    for count in counts:
        run: Run = {"scene": scene.name, "encode": {}}
        for effort in efforts:
            print(f"{scene.name}: encode {count or 'all'} at effort {effort}", file=sys.stderr)
            path = cache_path(scene, f"scale-q{QUALITY:g}-e{effort}-n{count}")
            options = {"quality": QUALITY, "effort": effort}
            took = child.run(job="encode", scene=scene.name, count=count, options=options, out=str(path))
            run["encode"][str(effort)] = took
        facts = inspect(path)
        run |= {"source_count": facts["source_count"], "anchors": facts["anchors"], "decode": measure_decoding(path)}
        add("sizes", f"{scene.name} {run['source_count']:09d}", run)


def measure_decoding(path: Path) -> Run:
    """Bytes of a file, and what each way of reading it takes."""
    print(f"decode {path.name}", file=sys.stderr)
    jobs: dict[str, child.Job] = {
        "stream": {"job": "export", "file": str(path)},
        "first": {"job": "decode", "file": str(path), "layers": 1, "runs": 1},
        "arrays": {"job": "decode", "file": str(path), "runs": 1},
    }
    if inspect(path)["anchors"] > MOST_IN_ARRAYS:
        del jobs["arrays"]
    times = child.run_in_turns(jobs, 1)
    return {**times, "inspect": child.run(job="inspect", file=str(path)), "bytes": path.stat().st_size}


# In ranges


def write_copies(source: Scene, count: int, path: Path) -> None:
    """Write a PLY of exactly `count` Gaussians while it is made: copies side by side on the ground, the last in part.

    Each is moved to a place of its own, and but for the first also jittered (positions by about a tenth of a Gaussian's
    size, log-scales and opacities a little) and recoloured (one gain for each colour of the copy, and a little noise).
    Numbers repeat nowhere; where there is more detail, and where less, does.
    """
    scene, _ = clean(load(source.path), drop_invalid=True)
    assert isinstance(scene, GaussianScene)
    axes = upward_axes(source.up)
    step = SPACING * core(scene, axes[2])[1]
    columns = int(np.ceil(np.sqrt(-(-count // len(scene)))))
    with atomic_write(path) as stream:
        comments = [f"copies of {source.name}, moved, jittered and recoloured"]
        stream.write(ply_header(count, scene.sh.shape[1] - 1, comments))
        for number in range(-(-count // len(scene))):
            made = copy_of(scene, number)
            place = step * ((number % columns) * axes[0] + (number // columns) * axes[1])
            part = replace(made, positions=made.positions + place).rows(slice(0, count - number * len(scene)))
            stream.write(ply_rows(part).data)


def copy_of(scene: GaussianScene, number: int) -> GaussianScene:
    """A copy of a scene in its place; the first is the scene."""
    if number == 0:
        return scene
    random = np.random.default_rng([0, number])
    size = np.exp(scene.log_scales.astype(np.float64)).mean(axis=1, keepdims=True)
    gain = np.exp(_GAIN * random.normal(size=3))
    colour = scene.sh * gain + _COLOUR_JITTER * random.normal(size=scene.sh.shape)
    return GaussianScene(
        scene.positions + _JITTER * size * random.normal(size=scene.positions.shape),
        (scene.log_scales + _SCALE_JITTER * random.normal(size=scene.log_scales.shape)).astype(np.float32),
        scene.rotations,
        (scene.opacity_logits + _OPACITY_JITTER * random.normal(size=len(scene))).astype(np.float32),
        colour.astype(np.float32),
    )


def measure_ranges(name: str, jobs: Sequence[child.Job], folder: Path, add: Add) -> None:
    """Encode copies of a scene in ranges and decode the files of one worker."""
    for job in jobs:
        source = folder / f"{name}-{job['gaussians']}.ply"
        if not source.exists():
            source.parent.mkdir(parents=True, exist_ok=True)
            write_copies(select_scenes([name])[0], job["gaussians"], source)
        key = f"{job['gaussians']} effort {job['effort']}, {job['workers']} {job['executor']}"
        print(key, file=sys.stderr, flush=True)
        out = folder / "scene.scar"
        found = child.run(
            child.ENVIRONMENT, **job, job="benchmarks.scale:encode_in_ranges", source=str(source), out=str(out)
        )
        run = {"scene": name, **job, "source_bytes": source.stat().st_size, **found}
        if job["workers"] == 1:
            run["decode"] = measure_decoding(out)
        add("ranges", key, run)


def encode_in_ranges(job: child.Job) -> Run:
    """Job of `benchmarks.child`: `scarfmt encode --work` on `source`.

    Returns:
        ``seconds``, ``cpu``, ``worker_peak_bytes``, ``bytes``, ``mean_db``, ``kept_bytes`` in the folder of work.
    """
    out = Path(job["out"])
    work = out.with_name("work")
    shutil.rmtree(work, ignore_errors=True)
    words = ["encode", job["source"], str(out), "--work", str(work), "--range-size", str(job["range"])]
    words += ["--effort", str(job["effort"]), "--force", "--quiet"]
    start = time.perf_counter()
    with Watch() as watch, start_cluster(job["workers"], job["executor"]) as options:
        subprocess.run([sys.executable, "-m", "scarfmt", *words, *options], cwd=REPOSITORY, check=True)
    seconds = time.perf_counter() - start
    kept = sum(path.stat().st_size for path in work.rglob("*") if path.is_file())
    shutil.rmtree(work)
    facts = inspect(out, metadata=True)
    took = {"seconds": seconds, "cpu": watch.cpu_seconds, "worker_peak_bytes": watch.peak_bytes}
    return {
        **took,
        "bytes": out.stat().st_size,
        "kept_bytes": kept,
        "mean_db": (facts.get("metadata") or {}).get("quality", {}).get("mean_db"),
    }


class Watch:
    """Looks at the processes that this one starts, whoever starts and ends them, while it is entered (Linux).

    Attributes:
        peak_bytes: most memory that any one of them held at once; 0 where there is none, or no Linux.
    """

    def __init__(self) -> None:
        self.peak_bytes = 0
        self._cpu: dict[int, float] = {}
        self._ended = threading.Event()
        self._own = 0.0
        self._thread = threading.Thread(target=self._look_on, daemon=True)

    def __enter__(self) -> Self:
        self._own = time.process_time()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        self._own = time.process_time() - self._own

    @property
    def cpu_seconds(self) -> float:
        """Processor time of this process and of its descendants, up to the last look at each."""
        return self._own + sum(self._cpu.values())

    def _look_on(self) -> None:
        while not self._ended.wait(WATCH_SECONDS):
            self.look()

    def look(self) -> None:
        """Look once."""
        parents, times = _processes()
        for process in parents:
            if _descends(process, os.getpid(), parents):
                self._cpu[process] = times[process]
                self.peak_bytes = max(self.peak_bytes, child.peak_bytes(process))


def _processes() -> tuple[dict[int, int], dict[int, float]]:
    """The parent of each process, and its processor time, seconds."""
    parents, times = {}, {}
    tick = os.sysconf("SC_CLK_TCK") if hasattr(os, "sysconf") else 100
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            # The name, in brackets, may hold anything.
            fields = path.read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()
        except OSError:
            continue
        process = int(path.parent.name)
        parents[process], times[process] = int(fields[1]), (int(fields[11]) + int(fields[12])) / tick
    return parents, times


def _descends(process: int, ancestor: int, parents: dict[int, int]) -> bool:
    while process in parents:
        process = parents[process]
        if process == ancestor:
            return True
    return False


@contextmanager
def start_cluster(workers: int, executor: str) -> Iterator[list[str]]:
    """Inside, workers of an executor run where it needs them; the options of `scarfmt encode` that use them."""
    if executor == "processes":
        yield ["--workers", str(workers)]
        return
    from distributed import LocalCluster

    make: Any = LocalCluster
    with make(n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        yield ["--cluster", str(cluster.scheduler_address)]


# Tables and plots


SERIES: dict[str, Callable[[Run], Run | None]] = {
    "encode, effort 1": lambda run: run.get("encode", {}).get("1"),
    "encode, effort 2": lambda run: run.get("encode", {}).get("2"),
    "decode, tile by tile": lambda run: run.get("decode", {}).get("stream"),
    "decode, into arrays": lambda run: run.get("decode", {}).get("arrays"),
    "decode, first layer": lambda run: run.get("decode", {}).get("first"),
}
"""What is measured at every size: how to find processor seconds (`cpu`) and `peak_bytes`, or None."""


def slope(points: Sequence[tuple[float, float]]) -> float:
    """Exponent b of the line y = a * x^b nearest to (x, y) points, by least squares of the logarithms.

    NaN for fewer than two different x.
    """
    if len({x for x, _ in points}) < 2:
        return math.nan
    x, y = np.log(np.array(points, np.float64).T)
    return float(np.polyfit(x, y, 1)[0])


def find_points(runs: Sequence[Run], series: str, field: str) -> list[tuple[float, float]]:
    """(Gaussians, value) of a series where it was measured."""
    found = ((run["source_count"], SERIES[series](run)) for run in runs)
    return [(float(count), float(job[field])) for count, job in found if job is not None]


def make_sizes_table(results: Mapping[str, Run]) -> str:
    """Processor seconds and memory by size, then the slopes."""
    runs = _sort_sizes(results)
    head = ["Gaussians", "effort 1 s", "MiB", "effort 2 s", "MiB", "tiles s", "MiB", "arrays s", "MiB"]
    head += ["layer 1 s", "MiB", "inspect ms", "bytes"]
    rows = []
    for run in runs:
        costs = [cell for series in SERIES for cell in _cost(SERIES[series](run))]
        found = run["decode"]
        size = f"{run['source_count']:,}{' (copies)' if 'copies' in run else ''}"
        rows.append([size, *costs, f"{1000 * found['inspect']['seconds']:.1f}", f"{found['bytes']:,}"])
    text = table(head, rows)
    rows = []
    for series in SERIES:
        numbers = [
            slope([point for point in find_points(runs, series, field) if point[0] >= LARGE])
            for field in ("cpu", "peak_bytes")
        ]
        rows.append([series, *("-" if math.isnan(number) else f"{number:.2f}" for number in numbers)])
    return f"{text}\n{table([f'slope from {LARGE:,} Gaussians on', 'time', 'memory'], rows)}"


def _sort_sizes(results: Mapping[str, Run]) -> list[Run]:
    return sorted(results.values(), key=lambda run: int(run["source_count"]))


def _cost(job: Run | None) -> list[str]:
    return ["-", "-"] if job is None else [f"{job['cpu']:.2f}", f"{job['peak_bytes'] / 2**20:,.0f}"]


def make_ranges_table(results: Mapping[str, Run]) -> str:
    """One run in ranges a line, then how well two workers do."""
    head = ["Gaussians", "effort", "workers", "s", "processor s a million", "peak MiB", "of a worker"]
    head += ["bytes a Gaussian", "kept meanwhile", "mean dB"]
    runs = sorted(results.values(), key=_order)
    rows = [
        [
            f"{run['gaussians']:,}",
            str(run["effort"]),
            f"{run['workers']} {run['executor']}",
            f"{run['seconds']:,.0f}",
            f"{1e6 * run['cpu'] / run['gaussians']:.1f}",
            f"{run['peak_bytes'] / 2**20:,.0f}",
            f"{run['worker_peak_bytes'] / 2**20:,.0f}" if run["worker_peak_bytes"] else "-",
            f"{run['bytes'] / run['gaussians']:.2f}",
            f"{run['kept_bytes'] / run['gaussians']:.0f}",
            "-" if run["mean_db"] is None else f"{run['mean_db']:.2f}",
        ]
        for run in runs
    ]
    alone = {(run["effort"], run["gaussians"]): run["seconds"] for run in runs if run["workers"] == 1}
    lines = [
        f"Two workers ({run['executor']}), effort {run['effort']}, {run['gaussians']:,} Gaussians:"
        f" efficiency {alone[key] / 2 / run['seconds']:.2f}."
        for run in runs
        if run["workers"] == 2 and (key := (run["effort"], run["gaussians"])) in alone
    ]
    return "\n".join([table(head, rows, 3), *lines])


def _order(run: Run) -> tuple[Any, ...]:
    return run["effort"], run["gaussians"], run["workers"], run["executor"]


SECTIONS = {"sizes": make_sizes_table, "ranges": make_ranges_table}


def draw_plot(results: Mapping[str, Run], keep: bool) -> None:
    """Processor time against Gaussians."""
    runs = _sort_sizes(results)
    figure, axes = new_plot("Gaussians", "processor s", log_x=True, log_y=True)
    for number, series in enumerate(SERIES):
        if found := find_points(runs, series, "cpu"):
            line(axes, [x for x, _ in found], [y for _, y in found], series, number)
    save_plot(figure, f"{NAME}-time", keep)


# The command


def main() -> None:
    """The command line."""
    parser = make_parser(__doc__, scenes=False)
    parser.add_argument("--sections", nargs="+", choices=SECTIONS, default=list(SECTIONS))
    parser.add_argument("--gaussians", nargs="+", type=int, metavar="N", help="sizes of `ranges`")
    parser.add_argument("--effort", nargs="+", type=int, default=[1], help="efforts of `ranges`")
    parser.add_argument("--workers", nargs="+", type=int, default=[1])
    parser.add_argument("--executor", nargs="+", choices=EXECUTORS, default=["processes"])
    parser.add_argument("--scratch", type=Path, default=SCRATCH / NAME, help="folder for large scenes and work")
    arguments = parser.parse_args()
    keep, short = not arguments.no_write, arguments.short
    name = SHORT_SCENE if short else SCENE
    sizes = arguments.gaussians or (SHORT_SIZES if short else SIZES)
    results = load_results(NAME) if keep or arguments.report else {}

    def add(section: str, key: str, run: Run) -> None:
        results.setdefault(section, {})[key] = run
        save_results(NAME, results, keep, [f"{section}/{key}"])

    sections = [] if arguments.report else arguments.sections
    if "sizes" in sections:
        counts, efforts = (SHORT_COUNTS, EFFORTS[:1]) if short else (COUNTS, EFFORTS)
        measure_sizes(select_scenes([name])[0], counts, efforts, add)
    if "ranges" in sections:
        jobs = [
            {"gaussians": count, "effort": effort, "workers": workers, "executor": executor}
            | {"range": SHORT_RANGE if short else RANGE}
            for count in sizes
            for effort in arguments.effort
            for executor in arguments.executor
            for workers in arguments.workers
        ]
        measure_ranges(name, jobs, arguments.scratch, add)
    draw_plot(results.get("sizes", {}), keep)
    publish(NAME, results, SECTIONS, keep, keep or arguments.report)


if __name__ == "__main__":
    main()
