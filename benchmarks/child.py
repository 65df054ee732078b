"""One job in a process of its own, so that its peak memory is its own: prints a JSON object on stdout.

    python -m benchmarks.child '{"job": "encode", "scene": "flowers", "options": {"quality": 45}, "out": "f.scar"}'
    python -m benchmarks.child '{"job": "decode", "file": "f.scar", "threads": 2}'

A job called MODULE:FUNCTION is that function, given the whole job.
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
"""Environment of children that decode, unless the caller says otherwise: only the decoder starts threads."""

Job = dict[str, Any]


def run(environment: Mapping[str, str] | None = None, **job: Any) -> dict[str, Any]:
    """Do `job` in a new process: what it reports, with ``peak_bytes`` of that process.

    Args:
        environment: variables to set or change.
        job: see `JOBS`.

    Raises:
        subprocess.CalledProcessError: it failed; its messages went to stderr.
    """
    command = [sys.executable, "-m", "benchmarks.child", json.dumps(job)]
    variables = {**os.environ, **(environment or {})}
    done = subprocess.run(command, cwd=REPOSITORY, env=variables, stdout=subprocess.PIPE, check=True)
    # The last line: a library may have had something to say.
    return dict(json.loads(done.stdout.splitlines()[-1]))


def in_turns(jobs: Mapping[str, Job], rounds: int) -> dict[str, dict[str, Any]]:
    """Time jobs against each other: each gets a process in every round, in the order given.

    Args:
        jobs: by name, what `run` takes; they report ``walls`` and ``cpus`` (`timed`).
        rounds: processes of each.

    Returns:
        By name, over all rounds: ``min`` and ``median`` of the wall seconds, ``cpu`` the least seconds of processor
        time, ``peak_bytes`` the least peak, ``runs``, and what else the last process reported.
    """
    found: dict[str, list[dict[str, Any]]] = {name: [] for name in jobs}
    for _ in range(rounds):
        for name, job in jobs.items():
            found[name].append(run(**{**job, "environment": {**ENVIRONMENT, **job.get("environment", {})}}))
    return {name: _together(reports) for name, reports in found.items()}


def _together(reports: list[dict[str, Any]]) -> dict[str, Any]:
    walls = [seconds for report in reports for seconds in report["walls"]]
    cpus = [seconds for report in reports for seconds in report["cpus"]]
    rest = {key: value for key, value in reports[-1].items() if key not in ("walls", "cpus", "seconds")}
    peak = min(report["peak_bytes"] for report in reports)
    times = {"min": min(walls), "median": statistics.median(walls), "cpu": min(cpus), "runs": len(walls)}
    return {**rest, **times, "peak_bytes": peak}


def peak_bytes() -> int:
    """Most memory this process ever held, bytes.

    Not `ru_maxrss` where Linux tells better: that one survives exec, so a child starts with its parent's peak.
    """
    status = Path("/proc/self/status")
    if status.exists():
        return int(status.read_text(encoding="utf-8").split("VmHWM:")[1].split()[0]) * 1024
    import resource

    # Bytes on macOS, the one other system this runs on.
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def note_path(path: Path) -> Path:
    """The file with the notes about a kept file."""
    return path.with_name(path.name + ".json")


def _encode(job: Job) -> dict[str, Any]:
    from benchmarks.scenes import chosen
    from reference_encoder.encode import encode
    from scarfmt.formats import load
    from scarfmt.formats.clean import clean

    scene = chosen([job["scene"]])[0]
    source, _ = clean(load(scene.path), drop_invalid=True)
    options = scene.options(**job["options"])
    start = time.perf_counter()
    data = encode(source, options)
    report = {"seconds": time.perf_counter() - start, "bytes": len(data)}
    note = {**report, "peak_bytes": peak_bytes()}
    path = Path(job["out"])
    # The file last: where it is, it is whole and its note is there.
    note_path(path).write_text(json.dumps(note), encoding="utf-8")
    part = path.with_name(path.name + ".part")
    part.write_bytes(data)
    part.replace(path)
    return report


def timed(act: Callable[[], object], runs: int = DECODE_RUNS, seconds: float = DECODE_SECONDS) -> dict[str, Any]:
    """Times of `act`, done at most `runs` times and not begun again after `seconds`; what it gives is dropped.

    Returns:
        ``walls`` and ``cpus``, each run's seconds by the wall and of processor time; ``seconds``, the least wall.
    """
    walls: list[float] = []
    cpus: list[float] = []
    while not walls or (len(walls) < runs and sum(walls) < seconds):
        wall, processor = time.perf_counter(), time.process_time()
        act()
        walls.append(time.perf_counter() - wall)
        cpus.append(time.process_time() - processor)
    return {"walls": walls, "cpus": cpus, "seconds": min(walls)}


def _decode(job: Job) -> dict[str, Any]:
    from reference_decoder.decode import decode

    count = 0

    def once() -> None:
        nonlocal count
        backend = job.get("backend", "auto")
        count = len(decode(job["file"], threads=job["threads"], layers=job.get("layers"), backend=backend).scene)

    if job.get("backend", "auto") in ("torch", "cuda"):
        import torch

        # Threads are over tiles, the decoder's own.
        torch.set_num_threads(1)
        once()
    return {**timed(once, job.get("runs", DECODE_RUNS)), "count": count}


def _export(job: Job) -> dict[str, Any]:
    from reference_decoder.stream_ply import export_ply

    start = time.perf_counter()
    count = export_ply(job["file"], job["out"], force=True)
    return {"seconds": time.perf_counter() - start, "count": count}


def _inspect(job: Job) -> dict[str, Any]:
    from scarfmt.container.source import open_source
    from scarfmt.tools.inspection import inspect

    start = time.perf_counter()
    with open_source(job["file"]) as source:
        inspect(source)
        return {"seconds": time.perf_counter() - start, "bytes_read": source.bytes_read, "reads": source.reads}


JOBS: dict[str, Callable[[Job], dict[str, Any]]] = {
    "encode": _encode,
    "decode": _decode,
    "export": _export,
    "inspect": _inspect,
}


def _named(name: str) -> Callable[[Job], dict[str, Any]]:
    if ":" not in name:
        return JOBS[name]
    module, function = name.split(":")
    found: Callable[[Job], dict[str, Any]] = getattr(import_module(module), function)
    return found


def main() -> None:
    job = json.loads(sys.argv[1])
    print(json.dumps({**_named(job["job"])(job), "peak_bytes": peak_bytes()}))


if __name__ == "__main__":
    main()
