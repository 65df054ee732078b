"""How fast the index network decodes, beside the limit of this machine for the same arithmetic.

    python -m benchmarks.entropy_speed            a few shapes, under a minute; prints and writes nothing (--short)
    python -m benchmarks.entropy_speed --full     every shape; rewrites docs/entropy-speed.md and its JSON

Decoding is the network and the rANS reading of indices: not the cell means that are its inputs, nor other channels.
The limit is the same matrix products in float32 and nothing else, then the same rANS reads of rows that are there
already, in as many threads. Every array library is measured in a process of its own, with one BLAS thread.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import numpy as np

from benchmarks.entropy_cases import Batch, Clock, Shape, decode_batch, make_batch, make_case
from benchmarks.report import dated, replace_section, save_results, table
from benchmarks.scenes import REPOSITORY
from reference_decoder.backends import operations
from scarfmt.arrays import F64
from scarfmt.entropy.rans import FrequencyTable, RansDecoder
from scarfmt.neural.evaluator import Evaluator
from scarfmt.neural.operations import Operations
from tests.neural.networks import Case

NAME = "entropy-speed"
PAGE = REPOSITORY / "docs" / "entropy-speed.md"
BACKENDS = ("numpy", "torch")
THREADS = (1, 2)
PARTS = ("embed", "context", "first rows", "member rows", "rANS", "advance")
WIDTHS = (16, 32, 64)
TARGETS = {64: 0.7, 32: 2.0}
"""Millions of indices a second on two cores, by H: what issue 3 asks for."""
STATIC_TARGET = 10
_QUIET = 1.0
SHORT = [*(Shape(2, h) for h in WIDTHS), Shape(4, 32), Shape(4, 64), Shape(2, 32, 128, two_level=False)]
FULL = [
    *(Shape(stages, h) for stages in (2, 4) for h in WIDTHS),
    *(Shape(stages, h, words, two_level=False) for words in (128, 1024) for stages in (2, 4) for h in WIDTHS),
    Shape(4, 32, attention=True),
]
ALPHABETS = (3, 16, 64)
_SYMBOLS = 1 << 20
_SYMBOLS_A_CALL = (_SYMBOLS, 256)
# The rows of a flat head of 1024 codewords take 8 KB an anchor and stage, and the limit keeps all of a batch.
_ANCHORS, _ANCHORS_FLAT = 8192, 1024
_BATCHES = 8
_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}

Job = Callable[[Batch], object]


class _Recorder:
    """Stands before the operations of an array library and keeps the operands of every product, and every row."""

    def __init__(self, inner: Operations) -> None:
        self._inner = inner
        self.products: list[tuple[Any, Any]] = []
        self.rows: list[F64] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)

    def product(self, x: Any, weights: Any) -> Any:
        self.products.append((x, weights))
        return self._inner.product(x, weights)

    def frequency_rows(self, logits: Any, exp2: Any) -> F64:
        self.rows.append(self._inner.frequency_rows(logits, exp2))
        return self.rows[-1]


def _limit(case: Case, do: Operations, batch: Batch) -> tuple[Job, Job]:
    """The products alone and the reads alone of `batch`, as jobs."""
    recorder = _Recorder(do)
    evaluator = Evaluator(case.network, case.books, recorder)
    # Those of making the evaluator are done once a file.
    recorder.products.clear()
    decode_batch(evaluator, case, batch.x, RansDecoder(batch.words), Clock())

    def products(_batch: Batch) -> None:
        for x, weights in recorder.products:
            do.product(x, weights)

    def reads(_batch: Batch) -> None:
        source = RansDecoder(batch.words)
        for rows in recorder.rows:
            source.decode_rows(rows)

    return products, reads


def _cost(job: Job, batches: Sequence[Batch], threads: int) -> tuple[float, float]:
    """Seconds by the wall and of processor time, all threads together."""
    with ThreadPoolExecutor(threads) as pool:
        wall, processor = time.perf_counter(), time.process_time()
        for _ in pool.map(job, batches):
            pass
        return time.perf_counter() - wall, time.process_time() - processor


def measure_shape(shape: Shape, backend: str, runs: int) -> dict[str, Any]:
    """Throughput, limit and parts of one shape; nanoseconds an index, the best of some runs that take turns."""
    case, do = make_case(shape), operations(backend)
    evaluator = Evaluator(case.network, case.books, do)
    count = _ANCHORS if shape.two_level or shape.words < 1024 else _ANCHORS_FLAT
    batches = [make_batch(case, count, seed) for seed in range(_BATCHES)]
    indices = count * _BATCHES * shape.stages
    clock = Clock()

    def decode(batch: Batch) -> None:
        decode_batch(evaluator, case, batch.x, RansDecoder(batch.words), clock)

    products, reads = _limit(case, do, batches[0])
    jobs = {"decode": decode, "products": products, "reads": reads}
    best: dict[str, Any] = {}
    for _ in range(runs):
        for threads in THREADS:
            for name, job in jobs.items():
                clock = Clock()
                wall, processor = (1e9 * seconds / indices for seconds in _cost(job, batches, threads))
                figures = best.setdefault(f"{name} {threads}", {"wall": np.inf, "cpu": np.inf})
                if name == "decode" and threads == 1 and processor < figures["cpu"]:
                    best["parts"] = {part: 1e9 * clock.seconds[part] / indices for part in PARTS}
                figures["wall"], figures["cpu"] = min(figures["wall"], wall), min(figures["cpu"], processor)
    return {"shape": shape.name, "backend": backend, "ns": best}


def measure_static(runs: int) -> list[dict[str, Any]]:
    """Millions of symbols a second of fixed tables, long runs and short."""
    rng = np.random.default_rng(0)
    words = rng.integers(1, 1 << 32, _SYMBOLS, dtype=np.uint64).astype("<u4").tobytes()
    out = []
    for alphabet in ALPHABETS:
        symbol_table = FrequencyTable.from_weights(rng.integers(1, 1000, alphabet))
        for run in _SYMBOLS_A_CALL:
            seconds = [_static_seconds(symbol_table, words, run) for _ in range(runs)]
            out.append({"alphabet": alphabet, "run": run, "millions": _SYMBOLS / min(seconds) / 1e6})
    return out


def _static_seconds(symbol_table: FrequencyTable, words: bytes, run: int) -> float:
    decoder, start = RansDecoder(words), time.perf_counter()
    for _ in range(_SYMBOLS // run):
        decoder.decode(symbol_table, run)
    return time.perf_counter() - start


def measure_backend(backend: str, full: bool) -> dict[str, Any]:
    """The measurements of a child process."""
    if backend == "torch":
        import torch

        # Threads are over batches, as a decoder has them over tiles.
        torch.set_num_threads(1)
    runs = 5 if full else 1
    static = measure_static(runs) if backend == "numpy" else []
    return {"static": static, "shapes": [measure_shape(shape, backend, runs) for shape in (FULL if full else SHORT)]}


def _child(backend: str, full: bool) -> dict[str, Any]:
    print(f"measuring {backend}", file=sys.stderr)
    command = [sys.executable, "-m", "benchmarks.entropy_speed", "--child", backend, *(["--full"] if full else [])]
    environment = {**os.environ, **_ONE_THREAD}
    done = subprocess.run(command, cwd=REPOSITORY, env=environment, stdout=subprocess.PIPE, check=True)
    return dict(json.loads(done.stdout))


def speed_rows(shapes: Sequence[dict[str, Any]]) -> list[list[str]]:
    """One row a shape, array library and number of threads."""
    rows = []
    for run in shapes:
        for threads in THREADS:
            wall, cpu = run["ns"][f"decode {threads}"]["wall"], run["ns"][f"decode {threads}"]["cpu"]
            limit = sum(run["ns"][f"{name} {threads}"]["cpu"] for name in ("products", "reads"))
            figures = [f"{1e3 / wall:.2f}", f"{cpu:,.0f}", f"{limit:,.0f}", f"{limit / cpu:.0%}"]
            rows.append([run["shape"], run["backend"], str(threads), *figures])
    return rows


def part_rows(shapes: Sequence[dict[str, Any]]) -> list[list[str]]:
    """Nanoseconds an index of each part, in one thread, and of the limit."""
    rows = []
    for run in shapes:
        figures = [f"{run['ns']['parts'][part]:,.0f}" for part in PARTS]
        limits = [f"{run['ns'][f'{name} 1']['cpu']:,.0f}" for name in ("products", "reads")]
        rows.append([run["shape"], run["backend"], *figures, *limits])
    return rows


def target_rows(results: dict[str, Any]) -> list[list[str]]:
    """The targets beside the measurements: the slowest and the fastest of the shapes they are about."""
    rows = []
    for hidden, wanted in TARGETS.items():
        names = {Shape(stages, hidden).name for stages in (2, 4)}
        costs = [run["ns"]["decode 2"] for run in results["shapes"] if _is(run, names, "numpy")]
        if costs:
            walls, most = [1e3 / cost["wall"] for cost in costs], [2e3 / cost["cpu"] for cost in costs]
            figures = [f"{min(millions):.2f} to {max(millions):.2f}" for millions in (walls, most)]
            rows.append([f"two-level, H = {hidden}, NumPy, 2 threads", f"at least {wanted} M indices/s", *figures])
    cpu = {(run["shape"], run["backend"]): run["ns"]["decode 1"]["cpu"] for run in results["shapes"]}
    ratios = [cpu[name, "numpy"] / ns for (name, backend), ns in cpu.items() if backend == "torch"]
    rows.append(
        ["torch on the CPU against NumPy, CPU time", "at least 1", f"{min(ratios):.2f} to {max(ratios):.2f}", ""]
    )
    millions = [run["millions"] for run in results["static"]]
    static = f"{min(millions):.0f} to {max(millions):.0f}"
    return [*rows, ["static tables, 1 thread", f"at least {STATIC_TARGET} M symbols/s", static, ""]]


def _is(run: dict[str, Any], names: set[str], backend: str) -> bool:
    return run["shape"] in names and run["backend"] == backend


def markdown(results: dict[str, Any]) -> str:
    """The tables of the page."""
    shapes = results["shapes"]
    static = [[str(run["alphabet"]), f"{run['run']:,}", f"{run['millions']:.0f}"] for run in results["static"]]
    speed_head = ["network", "arrays", "threads", "M indices/s", "CPU ns/index", "limit, CPU ns/index", "reached"]
    part_head = ["network", "arrays", *PARTS, "products alone", "reads alone"]
    return "\n\n".join(
        [
            "### Targets",
            table(["what", "asked for", "measured", "two free cores, at most"], target_rows(results)).rstrip(),
            "### Throughput",
            table(speed_head, speed_rows(shapes), text_columns=2).rstrip(),
            "### Where the time goes: CPU nanoseconds an index, one thread",
            table(part_head, part_rows(shapes), text_columns=2).rstrip(),
            "### Static tables, one thread",
            table(["alphabet", "symbols a call", "M symbols/s"], static).rstrip(),
            f"Load of the machine before and after: {results['load']}. Above {_QUIET:.0f} before, other programs took "
            "part of both cores: wall figures then say what was left.",
        ]
    )


def measure(full: bool) -> dict[str, Any]:
    """Everything, a process for each array library."""
    before = os.getloadavg()[0]
    parts = [_child(backend, full) for backend in BACKENDS]
    shapes = [run for pair in zip(*(part["shapes"] for part in parts), strict=True) for run in pair]
    load = f"{before:.1f}, {os.getloadavg()[0]:.1f}"
    return {"shapes": shapes, "static": parts[0]["static"], "load": load}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--full", action="store_true", help="every shape, more runs; keeps the results")
    parser.add_argument("--short", action="store_true", help="a few shapes; the default")
    parser.add_argument("--no-write", action="store_true", help="with --full: print the tables instead")
    parser.add_argument("--child", choices=BACKENDS, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.child:
        print(json.dumps(measure_backend(arguments.child, arguments.full)))
        return
    results = measure(arguments.full)
    keep = arguments.full and not arguments.no_write
    save_results(NAME, results, keep)
    show = partial(replace_section, NAME, page=PAGE) if keep else print
    show(dated(markdown(results), NAME, keep))


if __name__ == "__main__":
    main()
