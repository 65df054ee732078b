"""The start-up cost of a reader: importing it, and the time of its first file beyond that of later ones.

    python -m benchmarks.start_up scar f.scar
    python -m benchmarks.start_up gsply f.spz FOLDER

Prints seconds as a JSON object. Nothing is imported before the clock runs but what tells the time and writes this.
"""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Callable
from itertools import pairwise
from time import perf_counter
from typing import Any

_LATER = 3


def _scar() -> Callable[[str], object]:
    read: Callable[[str], object] = importlib.import_module("reference_decoder.decode").decode_scene
    return read


def _gsply() -> Callable[[str], object]:
    sys.path.insert(0, sys.argv[3])
    read: Callable[[str], object] = importlib.import_module("gsply").read_spz
    return read


READERS = {"scar": _scar, "gsply": _gsply}


def opening(path: str) -> float:
    """Seconds to open a file: its header, its directory and its models, read and checked."""
    reader: Any = importlib.import_module("scarfmt.coding.reader")
    source: Any = importlib.import_module("scarfmt.container.source")
    best: Any = importlib.import_module("scarfmt.engines").best_engine()
    began = perf_counter()
    with source.open_source(path) as stream:
        reader.SceneReader(stream, engine=best).models()
    return perf_counter() - began


def main() -> None:
    kind, path = sys.argv[1:3]
    began = perf_counter()
    read = READERS[kind]()
    marks = [perf_counter()]
    for _ in range(1 + _LATER):
        read(path)
        marks.append(perf_counter())
    first, *later = (end - start for start, end in pairwise(marks))
    found = {"import": marks[0] - began, "first_more": first - min(later)}
    if kind == "scar":
        found["open"] = min(opening(path) for _ in range(_LATER))
    print(json.dumps(found))


if __name__ == "__main__":
    main()
