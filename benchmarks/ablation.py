"""The ablations of docs/ablations.md: what each part of the entropy model and the quantiser is worth.

    python -m benchmarks.ablation                       three scenes, samples: about 20 minutes on two idle cores
    python -m benchmarks.ablation --scene plush-on-bed  one of them
    python -m benchmarks.ablation --full                all rows, longer training: hours
    python -m benchmarks.ablation --report              only rewrite the tables

Results are kept in benchmarks/results/ablation.json by scene, study and variant as they come; what is there is not
measured again (`--again` does). Encoded scenes are kept in build/benchmarks/ablation: delete it after a change of the
encoder. The codes of a scene are the same for all variants of an entropy model, so distortion is equal by construction.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import torch

from benchmarks.ablation_scenes import OWN, QUANTISERS, Sample, encoded, sample, static_bytes
from benchmarks.ablation_tables import NAME, texts, write_page
from benchmarks.entropy_variants import BranchedMlp, GruOnly, StageMlp, build_variant
from benchmarks.judged import judgement
from benchmarks.latent import at_bits, learned_curves, thinned
from benchmarks.report import SCRATCH, add_arguments, load_results, save_results
from benchmarks.scenes import chosen
from reference_encoder.latent.autoencoder import AutoencoderOptions
from reference_encoder.latent.fit import codebook_size
from reference_encoder.latent.rvq import RvqOptions
from reference_encoder.networks.defaults import shape_for
from reference_encoder.networks.export import export
from reference_encoder.networks.grid import BinaryGrid, Lookup, default_levels, fit_box, wave_grid
from reference_encoder.networks.model import IndexModel
from reference_encoder.networks.shape import NetworkShape
from reference_encoder.networks.train import Examples, TrainOptions, measure, train
from reference_encoder.options import ESTIMATORS
from scarfmt.blocks.codebooks import pack_codebooks
from scarfmt.blocks.hash_grid import pack_grid
from scarfmt.blocks.index_network import pack_network
from scarfmt.cli.scenes import load_subject
from scarfmt.coding.writer import write_scene
from scarfmt.engines import best_engine
from scarfmt.neural.network import Inputs

SCENES = ("plush-on-bed", "flowers", "plush-on-bed, anchors")
SHORT_SCENES, SHORT_STUDY = ("plush-toys",), "context"
STUDIES = ("context", "spatial", "quantiser", "network", "estimator")
Record = dict[str, Any]

# Every network of a study is trained alike; the short mode gives all of them too little, but equally so.
SHORT, FULL = (60_000, 20_000, 8), (None, 20_000, 12)
"""Training rows (None: all but the held), held rows, epochs."""
BATCH, RATE = 512, 0.025
_ESTIMATOR_VECTORS = {False: 10_000, True: 40_000}
_ESTIMATOR_STEPS = {False: 400, True: 2000}
_ESTIMATOR_STAGES = 3
_WIDTHS = (8, 16, 32, 64, 128)
_WEIGHT_BITS = (4, 5, 6, 8, 12, 16)
_ACTIVATION_BITS = (8, 9, 10, 12)
_BASE = NetworkShape(hidden=16, middle=32, mixer=32, codeword_dims=24, weight_bits=5)

CONTEXTS: dict[str, type[IndexModel]] = {"MLP": StageMlp, "branched MLP": BranchedMlp, "GRU, no spatial input": GruOnly}
"""Variants of the first study that the product lacks."""


@dataclass(frozen=True)
class Job:
    """One figure to measure."""

    scene: str
    study: str
    variant: str
    seed: int = 0
    full: bool = False

    @property
    def key(self) -> str:
        """The name of this variant among the results."""
        return f"{self.scene} | {self.study} | {self.variant} | seed {self.seed}" + " | full" * self.full

    @property
    def rows(self) -> tuple[int | None, int, int]:
        """Training rows, held rows, epochs."""
        return FULL if self.full else SHORT


def prepare(scene: str) -> None:
    """Have a scene encoded."""
    encoded(scene)


def run(job: Job) -> Record:
    """Measure `job`: a record for the results file."""
    torch.set_num_threads(1)
    measured = {"context": _context, "spatial": _spatial, "quantiser": _quantiser, "estimator": _estimator}
    return {**asdict(job), **measured.get(job.study, _network)(job)}


def jobs(scene: str, full: bool) -> Iterator[Job]:
    """Everything to measure of a scene."""
    variants = {
        "context": ("static tables", *CONTEXTS, "GRU", "GRU + attention"),
        "spatial": tuple(SOURCES),
        "quantiser": tuple(QUANTISERS),
        "network": tuple(network_variants()),
        "estimator": ESTIMATORS,
    }
    for study in STUDIES:
        yield from (Job(scene, study, name, 0, full) for name in variants[study])
    for study in ("context", "estimator"):
        # Static tables are what they are: there is no chance in them.
        yield from (Job(scene, study, name, 1, full) for name in variants[study] if name != "static tables")


# Study 1


def _context(job: Job) -> Record:
    if job.variant == "static tables":
        indices, tables, symbols = static_bytes(encoded(job.scene).scene)
        rate = 8 * indices / symbols
        return {"bytes": indices + tables, "model_bytes": tables, "in_sample": rate, "symbols": symbols}
    data = sample(job.scene, OWN, *job.rows[:2])
    *columns, grid_bytes = _waves(data)
    data = _with_columns(data, *columns)
    shape = shape_for(data.train.symbols, data.books.dimension, job.variant == "GRU + attention")
    kind = CONTEXTS.get(job.variant)
    start = build_variant(kind, data.train, data.books, data.clusters, shape, job.seed) if kind else None
    return _trained(job, data, shape, 0 if kind is GruOnly else grid_bytes, start=start)


# Study 2: (cell means of decoded neighbours, "": no grid | "waves" | a kind of `default_levels`)
SOURCES = {
    "none": (False, ""),
    "3D grid": (False, "3d"),
    "hybrid grid": (False, "hybrid"),
    "fixed waves": (False, "waves"),
    "decoded": (True, ""),
    "decoded + waves": (True, "waves"),
    "decoded + hybrid grid": (True, "hybrid"),
}


def _spatial(job: Job) -> Record:
    decoded, kind = SOURCES[job.variant]
    data = sample(job.scene, OWN, *job.rows[:2])
    shape = shape_for(data.train.symbols, data.books.dimension)
    waves = _waves(data)
    if not decoded:
        data = _first_columns(data, data.columns)
    if kind == "waves":
        return _trained(job, _with_columns(data, *waves[:2]), shape, waves[2])
    if not kind:
        return _trained(job, data, shape, 0)
    box, extent = fit_box(data.train_positions)
    grid = BinaryGrid(box, default_levels(len(data.train), extent, kind), seed=job.seed)
    return _trained(job, data, shape, 0, grid=grid)


def _waves(data: Sample) -> tuple[Any, Any, int]:
    """Features of the fixed grid for both parts of a sample, and its bytes."""
    grid = wave_grid(fit_box(data.train_positions)[0])
    return grid.features(data.train_positions), grid.features(data.held_positions), len(pack_grid(grid))


def _with_columns(data: Sample, train_columns: Any, held_columns: Any) -> Sample:
    first = replace(data.train, inputs=np.concatenate([data.train.inputs, train_columns], axis=1))
    return replace(
        data, train=first, held=replace(data.held, inputs=np.concatenate([data.held.inputs, held_columns], axis=1))
    )


def _first_columns(data: Sample, count: int) -> Sample:
    first = replace(data.train, inputs=np.ascontiguousarray(data.train.inputs[:, :count]))
    return replace(data, train=first, held=replace(data.held, inputs=np.ascontiguousarray(data.held.inputs[:, :count])))


# Study 3


def _quantiser(job: Job) -> Record:
    found = encoded(job.scene, job.variant)
    scene = found.scene
    data = write_scene(scene, engine=best_engine())
    indices, tables, _ = static_bytes(scene)
    samples = sample(job.scene, job.variant, *job.rows[:2])
    waves = _waves(samples)
    shape = shape_for(samples.train.symbols, samples.books.dimension)
    record = _trained(job, _with_columns(samples, *waves[:2]), shape, waves[2])
    books = {number: book for number, book in enumerate((samples.books.coarse, samples.books.residual)) if len(book)}
    return {
        **record,
        "static_bytes": indices + tables,
        "file_bytes": len(data),
        "codebook_bytes": len(pack_codebooks(books)),
        "latent_error": found.error,
        "rate": found.problem.rate,
        "psnr_db": _psnr(job, data),
    }


def _psnr(job: Job, data: bytes) -> float:
    """Mean PSNR of the last layer against the source, over the scene's own views."""
    place = chosen([job.scene])[0]
    path = SCRATCH / "ablation" / f"{os.getpid()}.scar"
    path.write_bytes(data)
    source = load_subject(str(place.path)).remembering()
    found = judgement(source, load_subject(str(path)), place.judged_views(source))
    path.unlink()
    return float(found["psnr_db"])


# Study 4


def _estimator(job: Job) -> Record:
    problem = thinned(encoded(job.scene).problem, _ESTIMATOR_VECTORS[job.full])
    rvq = RvqOptions(codebook_size(len(problem.vectors)), _ESTIMATOR_STAGES, problem.rate, epochs=7, seed=job.seed)
    options = AutoencoderOptions(rvq, estimator=job.variant, steps=_ESTIMATOR_STEPS[job.full])
    began = time.process_time()
    floor, curves = learned_curves(problem, options)
    seconds = time.process_time() - began
    mean = np.average(problem.vectors, axis=0, weights=problem.weight)
    root = np.eye(len(mean)) if problem.metric is None else np.linalg.cholesky(problem.metric)
    nothing = float((problem.weight[:, None] * ((problem.vectors - mean) @ root) ** 2).sum())
    bits = np.arange(2.0, 41.0, 0.5)
    decibels = 10 * (at_bits(curves, bits) - np.log10(nothing))
    kept = {f"{b:g}": round(float(d), 3) for b, d in zip(bits, decibels, strict=True) if np.isfinite(d)}
    return {"decibels": kept, "floor_db": float(10 * np.log10(floor / nothing)), "seconds": seconds}


# Study 5


def network_variants() -> dict[str, tuple[NetworkShape, bool, bool]]:
    """Shape, whether in integers, and whether with clusters, of every network of the fifth study."""
    out = {}
    for width in _WIDTHS:
        shape = replace(_BASE, hidden=width, middle=2 * width, mixer=2 * width)
        out[f"H {width}"] = shape, True, True
        out[f"H {width}, float"] = shape, False, True
    out["flat head"] = _BASE, True, False
    out["flat head, float"] = _BASE, False, False
    for bits in _WEIGHT_BITS:
        limit = max(_BASE.weight_limit, (1 << (bits - 1)) - 1)
        out[f"weights {bits}"] = replace(_BASE, weight_bits=bits, weight_limit=limit), True, True
    for bits in _ACTIVATION_BITS:
        out[f"activations {bits}"] = replace(_BASE, activation_bits=bits), True, True
    return {name: kind for name, kind in out.items() if name == "H 16" or kind != out["H 16"]}


def _network(job: Job) -> Record:
    shape, quantised, clustered = network_variants()[job.variant]
    data = sample(job.scene, OWN, *job.rows[:2])
    waves = _waves(data)
    data = _with_columns(data, *waves[:2])
    shape = replace(shape, codeword_dims=min(shape.codeword_dims, data.books.dimension))
    data = data if clustered else replace(data, clusters=((), ()))
    return _trained(job, data, shape, waves[2], quantised=quantised)


# All networks


def _trained(
    job: Job,
    data: Sample,
    shape: NetworkShape,
    grid_bytes: float,
    *,
    start: IndexModel | None = None,
    grid: BinaryGrid | None = None,
    quantised: bool = True,
) -> Record:
    """Train on the sample and measure: bits an index on both parts, bytes of models, bytes of the whole scene.

    Bytes of the whole scene are those of this very network, sent along: rows it was trained on at their bits, all
    others at those of the held rows.
    """
    epochs = job.rows[2]
    options = TrainOptions(epochs, BATCH, RATE, quantised=quantised, patience=0.0, seed=job.seed)
    seen, unseen = (None if grid is None else grid.lookup(p) for p in (data.train_positions, data.held_positions))
    began = time.process_time()
    try:
        trained = train(data.train, data.books, data.clusters, shape, options, start=start, grid=grid, lookup=seen)
    except AssertionError as error:
        return {"failed": str(error)}
    seconds = time.process_time() - began
    parts = {"in_sample": (data.train, seen), "held_out": (data.held, unseen)}
    rates = {name: _rate(trained.model, rows, grid, look, quantised) for name, (rows, look) in parts.items()}
    grid_bytes += 0.0 if grid is None else len(pack_grid(grid.export()))
    with torch.no_grad():
        model_bytes = float(trained.model.weight_bits()) / 8
    sent = int((data.train.after - data.train.before).sum())
    symbols = data.train.symbols
    bits = rates["in_sample"] * sent + rates["held_out"] * (symbols - sent)
    total = {"bytes": bits / 8 + model_bytes + grid_bytes} if quantised else {}
    return {
        **total,
        **rates,
        "model_bytes": model_bytes,
        "packed_bytes": _packed(trained.model, data) if quantised and grid is None else None,
        "grid_bytes": grid_bytes,
        "symbols": symbols,
        "rows": len(data.train),
        "held": len(data.held),
        "epochs": epochs,
        "hidden": shape.hidden,
        "seconds": seconds,
    }


def _rate(model: IndexModel, rows: Any, grid: BinaryGrid | None, lookup: Lookup | None, quantised: bool) -> float:
    """Bits an index: of the integer frequencies themselves, or the float model's cross-entropy."""
    examples = Examples(rows, grid, lookup)
    return float(measure(model, examples, quantised, quantised).sum()) / examples.sent


def _packed(model: IndexModel, data: Sample) -> int | None:
    """Bytes of the network as a file holds it; None for those the format has no place for."""
    if type(model) is not IndexModel:
        return None
    # What the columns mean takes a few bytes whatever it is: all are said to be of a grid.
    return len(pack_network(export(model, Inputs(0, False, 0, 0, 0, 0, data.train.inputs.shape[1]), data.books)))


def _wanted(names: Sequence[str], studies: Sequence[str], full: bool, known: dict[str, Any]) -> list[Job]:
    every = [job for name in names for job in jobs(name, full)]
    found = [job for job in every if job.study in studies and job.key not in known]
    # A run that is cut short then has a seed of every scene.
    return sorted(found, key=lambda job: (job.seed, STUDIES.index(job.study)))


def _measure(wanted: Sequence[Job], results: dict[str, Any], workers: int, keep: bool) -> None:
    """Measure the jobs in processes of their own and keep each result as it comes."""
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=spawn) as pool:
        # First, alone: all others start from these.
        list(pool.map(prepare, dict.fromkeys(job.scene for job in wanted)))
        began, pending = time.perf_counter(), {pool.submit(run, job): job for job in wanted}
        for done, future in enumerate(as_completed(pending), start=1):
            job = pending[future]
            results.setdefault(job.study, {})[job.key] = future.result()
            save_results(NAME, results, keep, [f"{job.study}/{job.key}"])
            passed = time.perf_counter() - began
            print(f"{passed:5.0f} s  {done}/{len(pending)}  {job.key}", file=sys.stderr, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser, scenes=False)
    parser.add_argument("--scene", nargs="+", help=f"default: {', '.join(SCENES)}")
    parser.add_argument("--study", nargs="+", choices=STUDIES, default=STUDIES)
    parser.add_argument("--full", action="store_true", help="all rows and longer training")
    parser.add_argument("--again", action="store_true", help="measure also what has results already")
    parser.add_argument("--report", action="store_true", help="only rewrite docs/ablations.md")
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    keep = not arguments.no_write
    results = load_results(NAME) if keep or arguments.report else {}
    if not arguments.report:
        names = [scene.name for scene in chosen(arguments.scene or (SHORT_SCENES if arguments.short else SCENES))]
        known = {} if arguments.again else {key: done for study in results.values() for key, done in study.items()}
        wanted = _wanted(names, arguments.study, arguments.full, known)
        if arguments.short:
            wanted = [job for job in wanted if (job.study, job.seed) == (SHORT_STUDY, 0)]
        _measure(wanted, results, arguments.workers, keep)
    if keep:
        write_page(results)
    else:
        print("\n\n".join(texts(results).values()))


if __name__ == "__main__":
    main()
