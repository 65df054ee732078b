"""The time of decoding one file's symbols, by what codes them, and of one file by threads, array library and kernel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from benchmarks import child, gain
from benchmarks.encoded import encoded
from benchmarks.scenes import Scene
from scarfmt.container.source import open_source
from scarfmt.engines import absence
from scarfmt.tools.models_report import describe_models

Record = dict[str, Any]


def measure_entropy(
    scene: Scene, quality: float, effort: int, rounds: int, networks: Sequence[str] = (gain.NEURAL, gain.FLAT)
) -> Record:
    """One scene's symbols under static tables, with predictors, with index networks of two-level and of flat heads."""
    files = gain.files(scene, quality, effort, networks)
    jobs: dict[str, child.Job] = {k: {"job": "decode", "file": file["path"], "threads": 1} for k, file in files.items()}
    times = child.in_turns(jobs, rounds)
    rows = [
        {"kind": kind, "bytes": file["bytes"], "multiply_adds": _multiply_adds(file["path"]), "decode": times[kind]}
        for kind, file in files.items()
    ]
    return {"scene": scene.name, "quality": quality, "effort": effort, "kinds": rows}


def _multiply_adds(path: str) -> int:
    """The multiply-adds of an anchor of the last layer."""
    with open_source(path) as source:
        return int(describe_models(source)["multiply_adds"])


def cuda_here() -> bool:
    """Whether torch sees an NVIDIA GPU."""
    import torch

    return bool(torch.cuda.is_available())


def ways() -> dict[str, child.Job]:
    """Jobs, but for their file, of every way to decode that this machine offers, by name."""
    backends = ("numpy", "torch", *(["cuda"] if cuda_here() else []))
    kernels = {"": "0", **({", kernel": "1"} if absence() is None else {})}
    return {
        f"{backend}, {threads} thread{'s' * (threads > 1)}{name}": {
            "job": "decode",
            "backend": "auto" if backend == "numpy" else backend,
            "threads": threads,
            "environment": {"SCARFMT_KERNEL": switch},
        }
        for backend in backends
        for threads in (1, 2)
        for name, switch in kernels.items()
    }


def missing() -> list[str]:
    """The requirements that this machine does not meet, in words."""
    out = [] if cuda_here() else ["torch sees no CUDA GPU here, so none was measured"]
    return out + ([] if absence() is None else ["the compiled kernel is not built here, so all is without it"])


def measure_ways(scene: Scene, quality: float, effort: int, rounds: int, names: Sequence[str] | None = None) -> Record:
    """One file decoded in every way that there is here, or those of `names`."""
    path = encoded(scene, quality, effort)["path"]
    jobs = {name: {**way, "file": path} for name, way in ways().items() if names is None or name in names}
    times = child.in_turns(jobs, rounds)
    return {"scene": scene.name, "quality": quality, "effort": effort, "ways": times, "missing": missing()}
