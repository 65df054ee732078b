"""One job in a process of its own, so that its peak memory is its own: prints a JSON object on stdout.

    python -m benchmarks.child '{"job": "encode", "scene": "flowers", "options": {"quality": 45}, "out": "f.scar"}'
    python -m benchmarks.child '{"job": "decode", "file": "f.scar", "threads": 2}'

A job NAME is the function NAME_job here, MODULE:FUNCTION that one; it is given the whole job.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from benchmarks.scenes import REPOSITORY

DECODE_RUNS, DECODE_SECONDS = 3, 2.0
"""Decodes in one process: at most so many, none begun after so many seconds."""
ENVIRONMENT = {"OMP_WAIT_POLICY": "passive", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
"""Environment of timed children unless a job says otherwise: only the decoder starts threads."""

Job = dict[str, Any]


def run(environment: Mapping[str, str] | None = None, **job: Any) -> dict[str, Any]:
    """Do `job` in a new process.

    Args:
        environment: variables to set or change.
        job: ``job``, which names it, and what it takes.

    Returns:
        What the job reports, with ``peak_bytes`` of that process.

    Raises:
        subprocess.CalledProcessError: it failed; its messages went to stderr.
    """
    command = [sys.executable, "-m", "benchmarks.child", json.dumps(job)]
    variables = {**os.environ, **(environment or {})}
    done = subprocess.run(command, cwd=REPOSITORY, env=variables, stdout=subprocess.PIPE, check=True)
    # The last line only: a library may have printed something before.
    return dict(json.loads(done.stdout.splitlines()[-1]))


def run_in_turns(jobs: Mapping[str, Job], rounds: int) -> dict[str, dict[str, Any]]:
    """Time jobs against each other: each gets a process in every round, in the order given.

    Args:
        jobs: by name, what `run` takes; they report ``walls`` and ``cpus`` (:func:`time_calls`).
        rounds: processes of each.

    Returns:
        By name, over all rounds: ``min`` and ``median`` wall seconds, ``cpu`` the least processor seconds,
        ``peak_bytes`` the least peak, ``runs``, and what else the last process reported.
    """
    reports: dict[str, list[dict[str, Any]]] = {name: [] for name in jobs}
    for _ in range(rounds):
        for name, job in jobs.items():
            environment = {**ENVIRONMENT, **job.get("environment", {})}
            reports[name].append(run(**{**job, "environment": environment}))
    return {name: _combine(mine) for name, mine in reports.items()}


def _combine(reports: list[dict[str, Any]]) -> dict[str, Any]:
    walls = [seconds for report in reports for seconds in report["walls"]]
    cpus = [seconds for report in reports for seconds in report["cpus"]]
    rest = {key: value for key, value in reports[-1].items() if key not in ("walls", "cpus", "seconds")}
    peak = min(report["peak_bytes"] for report in reports)
    times = {"min": min(walls), "median": statistics.median(walls), "cpu": min(cpus), "runs": len(walls)}
    return {**rest, **times, "peak_bytes": peak}


def time_calls(act: Callable[[], object], runs: int = DECODE_RUNS) -> dict[str, Any]:
    """Call `act` at most `runs` times, beginning no call after `DECODE_SECONDS`.

    Returns:
        ``walls`` and ``cpus``, each call's wall and processor seconds; ``seconds``, the least wall.
    """
    walls: list[float] = []
    cpus: list[float] = []
    while not walls or (len(walls) < runs and sum(walls) < DECODE_SECONDS):
        wall, processor = time.perf_counter(), time.process_time()
        act()
        walls.append(time.perf_counter() - wall)
        cpus.append(time.process_time() - processor)
    return {"walls": walls, "cpus": cpus, "seconds": min(walls)}


def peak_bytes(process: int | str = "self") -> int:
    """Most memory a process ever held, bytes; 0 of another that has ended.

    Not `ru_maxrss` where Linux offers better: that one survives exec, so a child starts with its parent's peak.
    """
    try:
        status = Path(f"/proc/{process}/status").read_text(encoding="utf-8", errors="replace")
    except OSError:
        status = ""
    _, found, rest = status.partition("VmHWM:")
    if found or process != "self":
        return int(rest.split()[0]) * 1024 if found else 0
    import resource

    # Bytes on macOS, the one other system this runs on.
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def note_path(path: Path) -> Path:
    """The JSON file with the notes about a cached file."""
    return path.with_name(path.name + ".json")


def encode_job(job: Job) -> dict[str, Any]:
    """Encode the `count` Gaussians of `scene` nearest to its middle (absent or None: all) with `options` to `out`."""
    from benchmarks.scenes import load_gaussians, select_scenes
    from scarfmt.api import encode

    scene = select_scenes([job["scene"]])[0]
    source = load_gaussians(scene.path, job.get("count"))
    options = scene.options(**job["options"])
    wall, processor = time.perf_counter(), time.process_time()
    data = encode(source, options)
    took = {"seconds": time.perf_counter() - wall, "cpu": time.process_time() - processor}
    report = {**took, "bytes": len(data), "source_count": len(source), "peak_bytes": peak_bytes()}
    path = Path(job["out"])
    # The file last: where it is, it is complete and its note is there.
    note_path(path).write_text(json.dumps(report), encoding="utf-8")
    part = path.with_name(path.name + ".part")
    part.write_bytes(data)
    part.replace(path)
    return report


def decode_job(job: Job) -> dict[str, Any]:
    """Decode the first `layers` layers (absent: all) of `file` into arrays with `threads` threads, some times."""
    from reference_decoder.decode import decode_scene

    count = 0

    def once() -> None:
        nonlocal count
        count = len(decode_scene(job["file"], threads=job.get("threads", 1), layers=job.get("layers")))

    return {**time_calls(once, job.get("runs", DECODE_RUNS)), "count": count}


def export_job(job: Job) -> dict[str, Any]:
    """Decode `file` tile by tile and drop the arrays: what a region or a stream to disk costs."""
    from scarfmt.api import open as open_file

    def once() -> None:
        with open_file(job["file"]) as file:
            for _ in file.tiles():
                pass

    return time_calls(once, job.get("runs", 1))


def inspect_job(job: Job) -> dict[str, Any]:
    """Read the front of `file`."""
    from scarfmt.container.source import open_source
    from scarfmt.tools.inspection import inspect

    start = time.perf_counter()
    with open_source(job["file"]) as source:
        inspect(source)
        return {"seconds": time.perf_counter() - start, "bytes_read": source.bytes_read, "reads": source.reads}


def main() -> None:
    """Do the job given as the only argument."""
    job = json.loads(sys.argv[1])
    module, _, name = job["job"].rpartition(":")
    act = getattr(import_module(module), name) if module else globals()[f"{name}_job"]
    print(json.dumps({**act(job), "peak_bytes": peak_bytes()}))


if __name__ == "__main__":
    main()
