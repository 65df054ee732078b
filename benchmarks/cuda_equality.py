"""Whether an NVIDIA GPU computes what NumPy computes: the rows of random networks, synthetic streams, whole files.

    python -m benchmarks.cuda_equality                     the conformance vectors
    python -m benchmarks.cuda_equality scene.scar ...      these files, too
    python -m benchmarks.cuda_equality --backend torch     the same comparison with torch on the CPU

Exits with 1 if anything differs, with 77 if torch sees no CUDA GPU: nothing was compared then.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Iterable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.entropy_cases import Clock, Shape, decode_batch, make_batch, make_case
from benchmarks.entropy_stress import equal, make_question, rows_of
from benchmarks.report import SKIPPED, add_arguments
from benchmarks.scenes import REPOSITORY
from reference_decoder.backends import TORCH, operations
from reference_decoder.decode import decode
from scarfmt.entropy.rans import RansDecoder
from scarfmt.errors import InvalidInput
from scarfmt.neural.evaluator import Evaluator
from scarfmt.neural.operations import NUMPY, Operations

VECTORS = REPOSITORY / "conformance" / "vectors"
NETWORKS, ANCHORS = 200, 20_000
SHAPES = [
    *(Shape(4, hidden, attention=attention) for hidden in (16, 64, 128) for attention in (False, True)),
    Shape(3, 32, 4096, two_level=False),
]


def compare_networks(do: Operations, count: int = NETWORKS) -> tuple[int, int]:
    """Random valid networks, their rows bit by bit: how many, and how many differ."""
    differ = 0
    for seed in range(count):
        question = make_question(seed)
        network, books = question.case.network, question.case.books
        found, wanted = (rows_of(Evaluator(network, books, way), question) for way in (do, NUMPY))
        differ += not equal(found, wanted)
    return count, differ


def compare_streams(do: Operations, shapes: Iterable[Shape] = SHAPES, count: int = ANCHORS) -> tuple[int, int]:
    """Streams of `count` anchors of networks of real size: indices read, and how many differ."""
    read = differ = 0
    for shape in shapes:
        case = make_case(shape)
        batch = make_batch(case, count, seed=1)
        found, wanted = (
            decode_batch(Evaluator(case.network, case.books, way), case, batch.x, RansDecoder(batch.words), Clock())
            for way in (do, NUMPY)
        )
        read += wanted.size
        differ += int(np.count_nonzero(found != wanted))
    return read, differ


def compare_files(backend: str, paths: Iterable[Path]) -> tuple[int, int]:
    """Whole files, every array decoded: how many, and how many differ."""
    count = differ = 0
    for path in paths:
        found, wanted = (decode(str(path), backend=way) for way in (backend, "numpy"))
        differ += not _same(found, wanted)
        count += 1
    return count, differ


def _same(a: Any, b: Any) -> bool:
    """Whether two decoded scenes hold the same arrays."""
    for name in (field.name for field in fields(a)):
        left, right = getattr(a, name), getattr(b, name)
        pairs = [(left[key], right[key]) for key in left] if isinstance(left, dict) else [(left, right)]
        arrays = [pair for pair in pairs if isinstance(pair[0], np.ndarray)]
        if not all(np.array_equal(*pair) for pair in arrays):
            return False
    return True


def _vectors() -> list[Path]:
    return sorted(path for kind in ("valid", "edge") for path in VECTORS.glob(f"{kind}/*/input.scar"))


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=Path, help="files to decode besides the conformance vectors")
    parser.add_argument("--backend", choices=TORCH, default="cuda")
    add_arguments(parser, scenes=False)
    chosen = parser.parse_args(arguments)
    try:
        do = operations(chosen.backend)
    except InvalidInput as refusal:
        print(f"SKIPPED, nothing was compared: {refusal}")
        return SKIPPED
    networks, shapes, anchors = (20, SHAPES[:1], 500) if chosen.short else (NETWORKS, SHAPES, ANCHORS)
    vectors = _vectors()[:: 20 if chosen.short else 1]
    results = {
        "random networks": compare_networks(do, networks),
        "indices of synthetic streams": compare_streams(do, shapes, anchors),
        "files": compare_files(chosen.backend, itertools.chain(vectors, chosen.files)),
    }
    for what, (count, differ) in results.items():
        print(f"{chosen.backend} against numpy: {count:,} {what}, {differ:,} differ")
    return int(any(differ for _, differ in results.values()))


if __name__ == "__main__":
    sys.exit(main())
