"""Run time against error, of whole files: decoding layer by layer, and encoding by effort."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from benchmarks import child
from benchmarks.encoded import encoded
from benchmarks.quality import distortion
from benchmarks.scenes import Scene
from scarfmt.container.source import open_source
from scarfmt.tools.inspection import inspect

THREADS = (1, 2)
Record = dict[str, Any]


def measure_layers(scene: Scene, quality: float, effort: int, rounds: int) -> Record:
    """Bytes, error and decode time of the first layer, the first two, and so on."""
    path = encoded(scene, quality, effort)["path"]
    layers = distortion(scene, Path(path))["layers"]
    jobs: dict[str, child.Job] = {
        f"{number} {threads}": {"job": "decode", "file": path, "threads": threads, "layers": number}
        for number in range(1, len(layers) + 1)
        for threads in THREADS
    }
    times = child.in_turns(jobs, rounds)
    rows = [
        {key: layer[key] for key in ("bytes", "psnr_db", "ssim", "anchors")}
        | {"decode": {str(threads): times[f"{number} {threads}"] for threads in THREADS}}
        for number, layer in enumerate(layers, start=1)
    ]
    facts = {"scene": scene.name, "quality": quality, "effort": effort, "layers": rows, "count": _source_count(path)}
    return {**facts, "other": _other_reads(path)}


def _other_reads(path: str) -> Record:
    """The measurements beside decoding: writing a PLY tile by tile, and reading the header."""
    told = child.run(child.ENVIRONMENT, job="inspect", file=path)
    out = Path(f"{path}.ply")
    export = child.run(child.ENVIRONMENT, job="export", file=path, out=str(out))
    out.unlink()
    return {"export": export, "inspect": told}


def _source_count(path: str) -> int:
    with open_source(path) as source:
        return int(inspect(source)["source_count"])


def measure_efforts(scene: Scene, qualities: Sequence[float], efforts: Sequence[int]) -> Record:
    """Encode time, memory, bytes and error by effort, at two or more qualities; the first is the one compared at."""
    runs = []
    for effort in efforts:
        for quality in sorted(qualities):
            file = encoded(scene, quality, effort)
            last = distortion(scene, Path(file["path"]))["layers"][-1]
            run = {key: file[key] for key in ("seconds", "peak_bytes", "bytes")}
            runs.append({**run, "effort": effort, "quality": quality, "psnr_db": last["psnr_db"]})
    return {"scene": scene.name, "runs": runs}


def at_equal_error(runs: Sequence[Record]) -> tuple[float, dict[int, float]]:
    """PSNR to compare at, dB, and the bytes of each effort there.

    It is the best of what the efforts reach at their lowest quality, so that every effort has a file on both sides:
    nothing is extrapolated. Between two files, the logarithm of bytes is taken to grow evenly with dB.

    Raises:
        ValueError: an effort does not reach so far at any quality.
    """
    curves: dict[int, list[tuple[float, float]]] = {}
    for run in sorted(runs, key=lambda run: float(run["psnr_db"])):
        curves.setdefault(run["effort"], []).append((run["psnr_db"], run["bytes"]))
    goal = max(curve[0][0] for curve in curves.values())
    return goal, {effort: _interpolated(curve, goal) for effort, curve in sorted(curves.items())}


def _interpolated(curve: Sequence[tuple[float, float]], goal: float) -> float:
    for (low, less), (high, more) in pairwise(curve):
        if low <= goal <= high:
            share = (goal - low) / (high - low) if high > low else 0.0
            return math.exp(math.log(less) + share * (math.log(more) - math.log(less)))
    if curve[0][0] == goal:
        return curve[0][1]
    raise ValueError(f"no two files on both sides of {goal:.2f} dB")
