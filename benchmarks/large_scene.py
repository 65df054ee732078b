"""Scenes larger than memory: processor time, memory and bytes of encoding in ranges, by size, executor and workers.

    python -m benchmarks.large_scene                          10 and 50 million Gaussians, efforts 1 and 2: hours
    python -m benchmarks.large_scene --gaussians 10000000 --effort 1 --workers 1 2
    python -m benchmarks.large_scene --short --no-write       some thousand Gaussians, printed
    python -m benchmarks.large_scene --make city.ply --gaussians 50000000

No scene of these sizes is at hand, so a large one is copies of a real one (`benchmarks.large_scene_copies`). Every
figure is of a process of its own with its workers, each of one thread, watched from outside (`benchmarks.watched`).
Results are merged into benchmarks/results/large-scene.json; the tables are in docs/large-scenes.md.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import child
from benchmarks.large_scene_copies import write_copies
from benchmarks.report import SCRATCH, add_arguments, dated, load_results, replace_section, save_results, table
from benchmarks.scenes import REPOSITORY, chosen
from benchmarks.watched import Watch

NAME = "large-scene"
PAGE = REPOSITORY / "docs" / "large-scenes.md"
SCENE, SIZES = "flowers", (10_000_000, 50_000_000)
SHORT_SCENE, SHORT_SIZES, SHORT_RANGE = "plush-toys", (4_000, 8_000), 2_000
EXECUTORS = ("processes", "dask")
SERIAL_STEPS = ("overlook", "fit", "train", "reduce", "merge")
"""Steps of one task: more workers do not shorten them."""
LEAST_MODELLED = 1_000_000
"""Least Gaussians of a scene from which a larger one can be predicted."""
BANDWIDTH = 1e9
"""Bytes a second that the store of a cluster is taken to give each worker."""
CLUSTER = 100
"""Workers that the model is asked about."""
ONE_THREAD = {**child.ENVIRONMENT, "NUMBA_NUM_THREADS": "1"}
"""Environment of all runs: a worker is one thread, also where this process is the only one."""

Figures = dict[str, Any]


def encode_job(job: Figures) -> Figures:
    """Job of `benchmarks.child`: encode a PLY in ranges.

    Args:
        job: ``path`` of the scene; ``folder`` for what is kept, removed at the end; ``effort``, ``range``, ``workers``;
            ``executor``, one of `EXECUTORS`: one worker of processes is this process.

    Returns:
        ``seconds``, ``cpu``, ``worker_peak_bytes``, ``bytes``, ``mean_db``, ``kept`` (bytes in each folder), ``steps``
        (seconds of each), ``gaussians``.
    """
    from reference_encoder.options import EncodeOptions
    from reference_encoder.scale.executor import workers
    from reference_encoder.scale.run import Job, encode_job
    from reference_encoder.scale.work import Work

    folder = Path(job["folder"])
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    options = EncodeOptions(effort=job["effort"])
    asked = Job(job["path"], Work(str(folder / "work")), options, "benchmark", range_size=job["range"])
    steps = Steps()
    start = time.perf_counter()
    with Watch() as watch, ExitStack() as stack:
        address = stack.enter_context(_cluster(job["workers"])) if job["executor"] == "dask" else None
        found = stack.enter_context(workers(job["workers"], address))
        with (folder / "scene.scar").open("wb") as target:
            done = encode_job(asked, found, target, steps.report)
        steps.end()
        kept = {path.name: _bytes_in(path) for path in sorted((folder / "work").iterdir())}
    seconds = time.perf_counter() - start
    shutil.rmtree(folder)
    measured = {"seconds": seconds, "cpu": watch.cpu_seconds, "worker_peak_bytes": watch.peak_bytes}
    return {
        **measured, "gaussians": done.count, "bytes": done.file_bytes, "mean_db": done.quality.mean_db,
        "kept": kept, "steps": steps.seconds,
    }  # fmt: skip


class _cluster:
    """Workers of Dask on this machine, processes of one thread; entered, the address of their scheduler."""

    def __init__(self, count: int) -> None:
        from distributed import LocalCluster

        make: Any = LocalCluster
        self._made = make(
            n_workers=count, threads_per_worker=1, processes=True, dashboard_address=None, memory_limit=0
        )

    def __enter__(self) -> str:
        return str(self._made.scheduler_address)

    def __exit__(self, *_: object) -> None:
        self._made.close()


class Steps:
    """Seconds of each step, by what is reported.

    Attributes:
        seconds: of each step so far.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._step = ""
        self._since = time.perf_counter()

    def report(self, said: str, _part: float) -> None:
        """A report of the encoder."""
        step = said.partition(":")[0]
        if step != self._step:
            self.end()
            self._step = step

    def end(self) -> None:
        """The current step is over."""
        now = time.perf_counter()
        if self._step:
            self.seconds[self._step] = self.seconds.get(self._step, 0.0) + now - self._since
        self._since = now


def _bytes_in(path: Path) -> int:
    files = path.rglob("*") if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files if file.is_file())


def moved_bytes(kept: Mapping[str, int], source_bytes: int) -> int:
    """Bytes read and written by all tasks of an encoding.

    The source is read three times, rows of ranges twice more (and of some to judge by), and what a range weighs, its
    symbols and its blocks as often as a later step needs them. What every worker reads once is not counted.
    """
    once = ("measured", "samples", "glances", "contents", "drawn", "histograms", "symbols", "segments")
    reads = {"bins": 3, **dict.fromkeys(once, 1)}
    return 3 * source_bytes + sum(size * (1 + reads.get(name, 0)) for name, size in kept.items())


def model(runs: Sequence[Figures], gaussians: float, workers: int) -> tuple[float, float, float]:
    """Seconds of the serial part, of the parallel part, and of moving bytes, predicted for a cluster.

    Args:
        runs: of one effort and one worker; two sizes tell what of the serial part grows with the scene.
        gaussians: of the scene.
        workers: of the cluster.
    """
    sizes = np.array([run["gaussians"] for run in runs], np.float64)
    serial = np.array([sum(run["steps"].get(step, 0.0) for step in SERIAL_STEPS) for run in runs])
    parallel = np.array([sum(run["steps"].values()) for run in runs]) - serial
    slope, base = np.polyfit(sizes, serial, 1) if len(set(sizes.tolist())) > 1 else (0.0, serial.mean())
    moved = max(moved_bytes(run["kept"], run["source_bytes"]) / run["gaussians"] for run in runs)
    each = float((parallel / sizes).max())
    alone = float(base + max(slope, 0.0) * gaussians)
    return alone, each * gaussians / workers, moved * gaussians / workers / BANDWIDTH


def runs_table(results: Mapping[str, Figures]) -> str:
    """The measurements, one run a line."""
    rows = [
        [
            f"{run['gaussians']:,}",
            str(run["effort"]),
            "this process" if _is_alone(run) else f"{run['workers']} {run['executor']}",
            f"{run['seconds']:,.0f}",
            f"{1e6 * run['cpu'] / run['gaussians']:.1f}",
            f"{run['peak_bytes'] / 2**20:,.0f}",
            f"{run['worker_peak_bytes'] / 2**20:,.0f}" if run["worker_peak_bytes"] else "-",
            f"{run['bytes'] / run['gaussians']:.2f}",
            f"{sum(run['kept'].values()) / run['gaussians']:.0f}",
            f"{run['mean_db']:.2f}",
        ]
        for run in sorted(results.values(), key=_order)
    ]
    head = ["Gaussians", "effort", "workers", "s", "processor s a million", "peak MiB", "of a worker"]
    return table([*head, "bytes a Gaussian", "kept meanwhile", "mean dB"], rows, 3)


def _order(run: Figures) -> tuple[Any, ...]:
    return run["effort"], run["gaussians"], run["workers"], run["executor"]


def efficiencies(results: Mapping[str, Figures]) -> list[str]:
    """How well two workers do what one does, where both were measured."""
    alone = {(run["effort"], run["gaussians"]): run["seconds"] for run in results.values() if _is_alone(run)}
    return [
        f"Two workers ({run['executor']}), effort {run['effort']}, {run['gaussians']:,} Gaussians:"
        f" efficiency {alone[key] / 2 / run['seconds']:.2f}."
        for run in sorted(results.values(), key=_order)
        if run["workers"] == 2 and (key := (run["effort"], run["gaussians"])) in alone
    ]


def _is_alone(run: Figures) -> bool:
    return bool(run["workers"] == 1 and run["executor"] == "processes")


def models(results: Mapping[str, Figures], gaussians: float = 1e9) -> list[str]:
    """The predictions of the model for a cluster, by effort."""
    lines = []
    alone = [run for run in results.values() if _is_alone(run) and run["gaussians"] >= LEAST_MODELLED]
    for effort in sorted({run["effort"] for run in alone}):
        runs = [run for run in alone if run["effort"] == effort]
        serial, parallel, moving = model(runs, gaussians, CLUSTER)
        total = serial + parallel + moving
        lines.append(
            f"Effort {effort}, {gaussians:,.0f} Gaussians, {CLUSTER} workers: {serial:,.0f} s serial,"
            f" {parallel:,.0f} s of work each, {moving:,.0f} s for moving bytes at {BANDWIDTH / 1e9:g} GB/s each:"
            f" {total / 3600:.2f} h, efficiency {parallel / total:.2f}."
        )
    return lines


def shown(results: Mapping[str, Figures]) -> str:
    """Tables and sentences of the page."""
    return "\n".join([runs_table(results), *efficiencies(results), "", *models(results)])


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser, scenes=False)
    parser.add_argument("--gaussians", nargs="+", type=int, metavar="N")
    parser.add_argument("--effort", nargs="+", type=int, default=[1])
    parser.add_argument("--workers", nargs="+", type=int, default=[1])
    parser.add_argument("--executor", nargs="+", choices=EXECUTORS, default=["processes"])
    parser.add_argument("--range-size", type=int)
    parser.add_argument("--scratch", type=Path, default=SCRATCH / NAME, help="folder for scenes and work")
    parser.add_argument("--make", type=Path, metavar="FILE", help="only write a scene of --gaussians")
    parser.add_argument("--report", action="store_true", help="measure nothing, rewrite the tables")
    arguments = parser.parse_args()
    name, usual = (SHORT_SCENE, SHORT_SIZES) if arguments.short else (SCENE, SIZES)
    sizes = arguments.gaussians or usual
    if arguments.make:
        write_copies(chosen([name])[0], sizes[0], arguments.make)
        return
    keep = not arguments.no_write
    results = load_results(NAME) if keep else {}
    for job in () if arguments.report else _jobs(arguments, name, sizes):
        key = f"{job['gaussians']} effort {job['effort']}, {job['workers']} {job['executor']}"
        print(key, file=sys.stderr, flush=True)
        results[key] = _measured(job, name)
        save_results(NAME, results, keep, [key])
    text = shown(results)
    if keep:
        partial(replace_section, NAME, page=PAGE)(dated(text, NAME, keep))
    else:
        print(text)


def _jobs(arguments: argparse.Namespace, name: str, sizes: Sequence[int]) -> list[Figures]:
    size = arguments.range_size or (SHORT_RANGE if arguments.short else 1_000_000)
    return [
        {
            "gaussians": count, "effort": effort, "workers": workers, "executor": executor, "range": size,
            "path": str(arguments.scratch / f"{name}-{count}.ply"), "folder": str(arguments.scratch / "work"),
        }
        for count in sizes for effort in arguments.effort for executor in arguments.executor
        for workers in arguments.workers
    ]  # fmt: skip


def _measured(job: Figures, name: str) -> Figures:
    path = Path(job["path"])
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_copies(chosen([name])[0], job["gaussians"], path)
    found = child.run(environment=ONE_THREAD, job="benchmarks.large_scene:encode_job", **job)
    told = {key: job[key] for key in ("effort", "workers", "executor", "range")}
    return {"scene": name, **told, "source_bytes": path.stat().st_size, **found}


if __name__ == "__main__":
    main()
