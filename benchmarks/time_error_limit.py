"""The parts of the time of a decode, with and without the compiled kernel, and the least time it could take.

The least is the sum of what no decoder can leave out, each measured alone in the same process: the multiply-adds of the
file's networks at the machine's integer peak (`benchmarks.integer_peak`), as many rANS symbols from tables that are
there already, and writing the arrays that come out. All in one thread.
"""

from __future__ import annotations

import subprocess
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from benchmarks import child, integer_peak
from benchmarks.encoded import encoded
from benchmarks.scenes import Scene
from reference_decoder import explicit
from reference_decoder.decode import decode, decode_scene
from reference_decoder.decoded import Decoded
from scarfmt.coding import engine
from scarfmt.engines import absence, best_engine
from scarfmt.entropy.rans import FrequencyTable, RansDecoder, SymbolSource, uniform_table
from scarfmt.neural.operations import NumpyOperations
from scarfmt.neural.predictor_group import PredictorGroup
from scarfmt.neural.predictors import Predictor
from scarfmt.scene.gaussians import GaussianScene

_ENGINE = type(best_engine())
STAGES = {
    "models": (
        ("scarfmt.coding.reader", "SceneReader.models"),
        ("scarfmt.coding.reader", "SceneReader._neural"),
        ("scarfmt.coding.reader", "SceneReader._whole_tiles"),
    ),
    "whole tiles": (("scarfmt.kernel.tiles", "KernelTiles.read"),),
    "positions": ((_ENGINE.__module__, f"{_ENGINE.__name__}.get_positions"),),
    "classes": (("scarfmt.coding.tile", "get_classes"),),
    "channel values": ((_ENGINE.__module__, f"{_ENGINE.__name__}.get_channel"),),
    "indices, static": (("scarfmt.coding.tile", "get_indices"),),
    "indices, network": ((_ENGINE.__module__, f"{_ENGINE.__name__}.get_neural_indices"),),
    "to world units": (("reference_decoder.decode", "tile_part"),),
    "activation": (
        ("reference_decoder.decoded", "Decoded.activated"),
        ("scarfmt.kernel.activation", "KernelActivation.put_tile"),
    ),
}
"""Functions whose time is reported, by what they do: module and name. None of them calls another.

With the kernel, files without an index network are read tile by tile, all streams in one call; else stream by stream.
World units are then part of the activation.
"""
PARTS = ("multiply-adds", "rANS", "arrays written")
RUNS = 3
_OTHER = "reading, checks, joining tiles"
Record = dict[str, Any]


@contextmanager
def stage_clock(seconds: defaultdict[str, float]) -> Iterator[None]:
    """Inside, the seconds spent in each of `STAGES` are added to `seconds`."""

    def timed(name: str, act: Callable[..., Any]) -> Callable[..., Any]:
        def wrapped(*arguments: Any, **named: Any) -> Any:
            began = time.perf_counter()
            try:
                return act(*arguments, **named)
            finally:
                seconds[name] += time.perf_counter() - began

        return wrapped

    with ExitStack() as stack:
        for name, module, path in ((name, *place) for name, places in STAGES.items() for place in places):
            *owners, attribute = path.split(".")
            owner = import_module(module)
            for part in owners:
                owner = getattr(owner, part)
            stack.enter_context(mock.patch.object(owner, attribute, timed(name, getattr(owner, attribute))))
        yield


def stages(job: Record) -> Record:
    """Child job: seconds of each stage of the fastest of some decodes, one thread, and of the whole."""
    best: dict[str, float] = {}
    for _ in range(RUNS):
        seconds: defaultdict[str, float] = defaultdict(float)
        began = time.perf_counter()
        with stage_clock(seconds):
            scene = decode_scene(job["file"], threads=1)
        whole = time.perf_counter() - began
        del scene
        if not best or whole < best["whole"]:
            best = {**seconds, _OTHER: whole - sum(seconds.values()), "whole": whole}
    return {"stages": best, "kernel": absence() is None, "walls": [best["whole"]], "cpus": [best["whole"]]}


@dataclass
class Recording:
    """The work that a decode cannot leave out.

    Attributes:
        products: how often each (rows, inner, columns) was multiplied.
        tables: by a table's identity, itself and the symbols read with it.
        modelled: symbols with frequencies of their own, by size of the alphabet.
        arrays: shape and type of every array that came out.
    """

    products: Counter[tuple[int, int, int]] = field(default_factory=Counter)
    tables: dict[int, tuple[FrequencyTable, int]] = field(default_factory=dict)
    modelled: Counter[int] = field(default_factory=Counter)
    arrays: list[tuple[tuple[int, ...], np.dtype[Any]]] = field(default_factory=list)


def record(path: str) -> Recording:
    """Decode a file without the kernel, in one thread, and note what was computed."""
    kept = Recording()
    product, contexts, begin = NumpyOperations.product, PredictorGroup.contexts, PredictorGroup.__init__
    sizes: dict[int, tuple[int, int]] = {}

    def counted_product(self: NumpyOperations, x: Any, weights: Any) -> Any:
        kept.products[len(x), *weights.shape] += 1
        return product(self, x, weights)

    def noted(self: PredictorGroup, predictors: Mapping[int, Predictor], *rest: Any) -> None:
        sizes[id(self)] = len(predictors), sum(predictor.units for predictor in predictors.values())
        begin(self, predictors, *rest)

    def counted_contexts(self: PredictorGroup, x: Any) -> Any:
        (predictors, units), (width, count) = sizes[id(self)], x.shape
        kept.products[2 * predictors, width, count] += 1
        if units:
            kept.products[units, width, count] += 1
            kept.products[2 * predictors, units, count] += 1
        return contexts(self, x)

    class Reading(RansDecoder):
        def decode(self, table: FrequencyTable, count: int) -> Any:
            if len(table) > 1:
                kept.tables[id(table)] = table, kept.tables.get(id(table), (table, 0))[1] + count
            return super().decode(table, count)

        def decode_rows(self, weights: Any) -> Any:
            if weights.shape[1] > 1:
                kept.modelled[weights.shape[1]] += len(weights)
            return super().decode_rows(weights)

    with (
        mock.patch.object(NumpyOperations, "product", counted_product),
        mock.patch.object(PredictorGroup, "__init__", noted),
        mock.patch.object(PredictorGroup, "contexts", counted_contexts),
        mock.patch.object(engine, "RansDecoder", Reading),
    ):
        decoded = decode(path, backend="numpy", threads=1)
    kept.arrays += [(array.shape, array.dtype) for array in _results(decoded)]
    network = decoded.models.decoder
    if network is not None:
        for layer in network.layers:
            outputs, inputs = layer.weights.shape
            kept.products[explicit.CHUNK, inputs, outputs] += -(-len(decoded) // explicit.CHUNK)
    return kept


def _results(decoded: Decoded) -> list[np.ndarray[Any, Any]]:
    scene = decoded.scene
    made = [value for value in vars(scene).values() if isinstance(value, np.ndarray)]
    # Positions of a scene are those that were decoded.
    fresh = made if isinstance(scene, GaussianScene) else []
    return decoded.arrays() + [array for array in fresh if array is not decoded.positions]


def multiply_add_ns() -> float:
    """Nanoseconds of a multiply-add of 16-bit pairs in registers; 0 where that cannot be measured: still a bound."""
    try:
        with tempfile.TemporaryDirectory() as folder:
            found = integer_peak.peaks(integer_peak.helper(Path(folder)))
    except (OSError, subprocess.CalledProcessError):
        return 0.0
    return 0.0 if found is None else found[0]


def readers(words: bytes) -> list[SymbolSource]:
    """The rANS decoders there are, at the beginning of `words`."""
    return [RansDecoder(words), *([best_engine().rans_decoder(words)] if absence() is None else [])]


def read_all(kept: Recording, source: SymbolSource) -> None:
    """Read as many symbols of the same tables, each table's in one run; those with tables of their own from equal
    shares."""
    for table, count in kept.tables.values():
        source.decode(table, count)
    for alphabet, count in kept.modelled.items():
        source.decode(uniform_table(alphabet), count)


def write_all(kept: Recording) -> None:
    """Fill fresh arrays of the same sizes."""
    for shape, dtype in kept.arrays:
        np.empty(shape, dtype).fill(0)


def least(job: Record) -> Record:
    """Child job: seconds of each of `PARTS` for a file, the best of some runs; rANS by the fastest reader."""
    kept = record(job["file"])
    count = sum(count for _, count in kept.tables.values()) + sum(kept.modelled.values())
    # Symbols draw themselves from random words: about three bytes each at the very most.
    words = np.random.default_rng(0).integers(1, 1 << 32, count + 2, dtype=np.uint64).astype("<u4").tobytes()
    best = {name: float("inf") for name in PARTS}
    for _ in range(RUNS):
        best["arrays written"] = min(best["arrays written"], _seconds(partial(write_all, kept)))
        for source in readers(words):
            best["rANS"] = min(best["rANS"], _seconds(partial(read_all, kept, source)))
    products = sum(times * rows * inner * columns for (rows, inner, columns), times in kept.products.items())
    peak = multiply_add_ns()
    best["multiply-adds"] = products * peak / 1e9
    return {"parts": best, "symbols": count, "multiply_adds": products, "multiply_add_ns": peak}


def _seconds(act: Callable[[], object]) -> float:
    began = time.perf_counter()
    act()
    return time.perf_counter() - began


def measure_limit(scene: Scene, quality: float, effort: int, rounds: int) -> Record:
    """Stages of one decode with the kernel and without, in turns, and the least that it could take."""
    path = encoded(scene, quality, effort)["path"]
    modes = {"off": "0", **({"on": "1"} if absence() is None else {})}
    job = {"job": "benchmarks.time_error_limit:stages", "file": path}
    jobs = {name: {**job, "environment": {"SCARFMT_KERNEL": value}} for name, value in modes.items()}
    found = child.in_turns(jobs, rounds)
    bound = child.run(child.ENVIRONMENT, job="benchmarks.time_error_limit:least", file=path)
    stages = {name: {**report["stages"], "whole": report["min"]} for name, report in found.items()}
    return {"scene": scene.name, "quality": quality, "effort": effort, "kernel": stages, "least": bound}
