"""How long reading a rival's file into float arrays takes, by two readers: this repository's importers, and gsply.

gsply is what a user of Python would install for it. It is not needed: where it is not here, only ours is timed.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks import child
from benchmarks.rivals_formats import read
from benchmarks.rivals_tools import PYTHON

OURS, GSPLY = "importer of this repository", "gsply"
_GSPLY_READS = {".spz": "read_spz", ".sog": "sogread", ".ply": "plyread"}


def reading_cost(path: Path, scale: float) -> dict[str, Any]:
    """The faster of the two readers: ``seconds`` (the least of some runs), ``peak_bytes`` and ``reader``."""
    job = {"job": "benchmarks.rivals_read:read_job", "file": str(path), "scale": scale}
    found = [{**child.run(child.ENVIRONMENT, **job, reader=reader), "reader": reader} for reader in readers(path)]
    best = min(found, key=lambda report: float(report["seconds"]))
    return {key: best[key] for key in ("seconds", "peak_bytes", "reader")}


def readers(path: Path) -> list[str]:
    """The readers that exist here for a file."""
    return [OURS, *([GSPLY] if path.suffix in _GSPLY_READS and (PYTHON / "gsply").exists() else [])]


def read_job(job: dict[str, Any]) -> dict[str, Any]:
    """Job of `benchmarks.child`: time one reader; what it compiles at first use is not counted."""
    return child.timed(reading(Path(job["file"]), job["scale"], job["reader"]))


def reading(path: Path, scale: float, reader: str) -> Callable[[], object]:
    """A function that reads a file once, by `OURS` or `GSPLY`."""
    if reader == OURS:
        return lambda: read(path, scale)
    sys.path.insert(0, str(PYTHON))
    gsply: Any = importlib.import_module("gsply")
    gsply.use_backend("auto")
    act = getattr(gsply, _GSPLY_READS[path.suffix])
    return lambda: act(str(path))
