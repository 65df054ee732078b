"""The worth of each mechanism of the format and of the encoder: a scene with one of them switched off.

    python -m benchmarks.mechanisms                        the scenes of `SCENES`: about half an hour
    python -m benchmarks.mechanisms --scenes plush-dog
    python -m benchmarks.mechanisms --short --no-write     the example scene, printed
    python -m benchmarks.mechanisms --report               only rewrite docs/mechanisms.md

Two studies. `coding`: the integers of a scene stay as they are and only their coding changes, so bytes say all; where
codewords are chosen again, bytes are of equal J = D + lambda R. `deciding`: other integers come out, so each way
encodes at two lambdas, and bytes are compared at equal mean PSNR over views of all kinds that the encoder has not
seen; files have static tables. Nothing here is an option of the encoder: the switches are put on from outside.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any
from unittest import mock

import numpy as np
from numpy.typing import NDArray

from benchmarks.gain import flat_heads
from benchmarks.mechanisms_tables import NAME, SCENES, texts, write_page
from benchmarks.report import add_arguments, load_results, save_results
from benchmarks.scenes import Scene, chosen
from reference_encoder import pipeline
from reference_encoder.decide import allocate, decision, plans
from reference_encoder.decide import lattice as cells
from reference_encoder.decide.allocate import LatentChain, plan_channel
from reference_encoder.judge.finished import finished_gaussians
from reference_encoder.networks import candidates as neural
from reference_encoder.networks import view
from reference_encoder.networks.candidates import another_round, with_index_network, with_predictors
from reference_encoder.networks.grid import wave_grid
from reference_encoder.options import EFFORTS, EncodeOptions
from reference_encoder.profiles import explicit
from reference_encoder.tuning import CONTEXT, GAUSSIAN_COARSEST, WAVE_RESOLUTIONS
from scarfmt.arrays import F64, I64
from scarfmt.coding.writer import QuantisedScene, silent, write_scene
from scarfmt.container.schema import Stream
from scarfmt.engines import best_engine
from scarfmt.formats import load
from scarfmt.formats.clean import clean
from scarfmt.render.camera import Camera
from scarfmt.render.metrics import psnr
from scarfmt.render.rasterise import render
from scarfmt.render.viewpoints import KINDS, Surroundings, viewpoints
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.scene.model import ContextRule

QUALITY, SECOND_QUALITY = 45.0, 47.0
"""Qualities at which lambda is set; the second also gives a point of the curve of `deciding`."""
EFFORT, SHORT_EFFORT = 2, 1
_VIEWS, _VIEW_SEED, _SAMPLED = 6, 20_000_003, 3
"""Judged views of each kind, their seed, and one pixel of so many squared."""
_MOST_DB = 99.0
"""PSNR that equal pictures count as, dB."""
Record = dict[str, Any]
Switch = Callable[[], AbstractContextManager[Any]]


# Coding: the same integers


def coding(scene: Scene, effort: int) -> Iterator[tuple[str, Record]]:
    """(mechanism, bytes with and without it) of the same integers."""
    options = scene.options(quality=QUALITY, effort=effort, corrections=0)
    source, _ = clean(load(scene.path), drop_invalid=True)
    profile = pipeline.measured(source, options, silent)
    attempt = pipeline.attempted(profile, QUALITY)
    plain = profile.finish(attempt.problem, attempt.decision)
    with_rules = _predicted(plain.scene, options)
    learned = with_index_network(with_rules, options, silent)
    best = with_rules if learned is None else learned.scene
    whole, predicted = _size(best), _size(with_rules)

    def record(without: float, against: int) -> Record:
        return {"bytes": whole, "without": without - against + whole}

    yield "predictors", record(_size(plain.scene), predicted)
    for stream in sorted({key[0] for group in with_rules.predictors.values() for key in (p.key for p in group)}):
        yield f"predictors of {Stream(stream).name}", record(_size(_without_stream(with_rules, stream)), predicted)
    for name, context in CONTEXTS.items():
        with mock.patch.object(neural, "CONTEXT", context):
            yield name, record(_size(_predicted(plain.scene, options)), predicted)
    for name, rule in RULES.items():
        yield name, record(_size(_predicted(_ruled(plain.scene, rule), options)), predicted)
    if learned is None:
        return
    yield "index network", record(predicted, whole)
    for name, switch in NETWORK.items():
        with switch():
            tried = with_index_network(with_rules, options, silent)
        yield name, record(_size(with_rules if tried is None else tried.scene), whole)
    if plain.targets is not None:
        again = another_round(learned, plain.targets, options, silent)
        costs = [plain.targets.cost(found.scene, _size(found.scene)) for found in (learned, again)]
        saved = (costs[0] - costs[1]) / (8 * plain.targets.lambda_)
        yield "codewords chosen again", {"bytes": whole, "without": whole + saved}


CONTEXTS = {
    "passes": replace(CONTEXT, passes_log2=0),
    "cell means": replace(CONTEXT, occupancies=()),
    "cell means of the finer cells": replace(CONTEXT, occupancies=CONTEXT.occupancies[:1]),
    "cell means of the coarser cells": replace(CONTEXT, occupancies=CONTEXT.occupancies[1:]),
}
"""Decoded contexts that lack something."""
RULES: dict[str, Callable[[ContextRule], ContextRule]] = {
    "earlier components as contexts": lambda rule: ContextRule(by_class=rule.by_class),
    "classes as contexts": lambda rule: replace(rule, by_class=False),
}
"""Static contexts that lack something."""


def _predicted(scene: QuantisedScene, options: EncodeOptions) -> QuantisedScene:
    return with_predictors(scene, options, silent) or scene


def _size(scene: QuantisedScene) -> int:
    return len(write_scene(scene, engine=best_engine()))


def _without_stream(scene: QuantisedScene, stream: int) -> QuantisedScene:
    kept = {layer: tuple(p for p in group if p.key[0] != stream) for layer, group in scene.predictors.items()}
    return replace(scene, predictors={layer: group for layer, group in kept.items() if group})


def _ruled(scene: QuantisedScene, rule: Callable[[ContextRule], ContextRule]) -> QuantisedScene:
    channels = tuple(replace(channel, rules=tuple(map(rule, channel.rules))) for channel in scene.model.channels)
    return replace(scene, model=replace(scene.model, channels=channels))


def _longest_waves() -> AbstractContextManager[Any]:
    """Inside, an index network sees only the longest waves along each axis."""
    return mock.patch.object(view, "wave_grid", partial(wave_grid, resolutions=WAVE_RESOLUTIONS[:1]))


NETWORK: dict[str, Switch] = {"two-level heads": flat_heads, "all waves but the longest": _longest_waves}
"""Index networks that lack something."""


# Deciding: other integers


def deciding(scene: Scene, effort: int) -> Iterator[tuple[str, Record]]:
    """(mechanism, points of its curve and of the encoder's own): bytes and dB at both lambdas."""
    source, _ = clean(load(scene.path), drop_invalid=True)
    assert isinstance(source, GaussianScene)
    profile = explicit.ExplicitProfile.measured(
        source, scene.options(quality=QUALITY, effort=effort, corrections=0), silent
    )
    cameras = judged_cameras(source, scene.up)
    pictures = [render(source, camera) for camera in cameras]

    def point(quality: float, **changed: Any) -> tuple[int, float]:
        own = replace(profile, options=replace(scene.options(quality=quality, effort=effort, corrections=0), **changed))
        attempt = pipeline.attempted(own, quality)
        found = finished_gaussians(attempt.plain.scene)
        each = [
            min(psnr(render(found, camera), seen), _MOST_DB) for camera, seen in zip(cameras, pictures, strict=True)
        ]
        return _size(attempt.plain.scene), float(np.mean(each))

    def curve(**changed: Any) -> list[tuple[int, float]]:
        return [point(quality, **changed) for quality in (QUALITY, SECOND_QUALITY)]

    own = curve()
    latent = source.sh_degree > 0 and bool(np.any(source.sh[:, 1:]))
    for name, switch in DECIDING.items():
        if latent or name not in OF_LATENTS:
            with switch():
                yield name, {"own": own, "without": curve()}
    yield "layers (their price)", {"own": own, "without": curve(layers=1)}


def judged_cameras(scene: GaussianScene, up: str) -> list[Camera]:
    """Views of all kinds, sampled."""
    around = Surroundings.of(scene, up)
    every = (camera for kind in KINDS for camera in viewpoints(around, kind, _VIEWS, _VIEW_SEED))
    return [camera.sampled(_SAMPLED) for camera in every]


def _nearest(values: F64, _weight: F64, classes: I64, _lambda: float, units: F64 | None = None) -> I64:
    return np.rint(values if units is None else values / units[classes]).astype(np.int64)


def _unaligned(caps: tuple[float, ...], *_: Any) -> tuple[float, ...]:
    return caps


@contextmanager
def _no_residual() -> Iterator[None]:
    """Inside, positions are those of cells, which are as fine as suits half of a tile's anchors."""
    caps = {stream: cap for stream, cap in GAUSSIAN_COARSEST.items() if stream != Stream.POSITION_RESIDUAL}
    with (
        mock.patch.object(explicit, "GAUSSIAN_COARSEST", caps),
        mock.patch.object(cells, "CELL_FACTOR", 1.0),
        mock.patch.object(cells, "CELL_PERCENTILE", 50),
    ):
        yield


@contextmanager
def _latent(changed: Callable[..., Any]) -> Iterator[None]:
    """Inside, the plan of a latent is changed (problem.fitted, classes, count, lambda; the plan)."""
    whole = plans._latent_plans

    def planned(*asked: Any) -> Any:
        return changed(asked, *whole(*asked))

    with mock.patch.object(plans, "_latent_plans", planned):
        yield


def _no_channel(_: Any, plan: Any, chain: LatentChain, left: F64) -> Any:
    kept = chain.stages + 1
    return plan, LatentChain(chain.stages, chain.bits[:, :kept], chain.error[:, :kept]), left


def _no_codewords(asked: Any, plan: Any, _: LatentChain, __: F64) -> Any:
    fitted, classes, count, _lambda = asked
    values = fitted.latent.values.astype(np.float64)
    weight: NDArray[np.float64] = fitted.latent.weight[:, None].astype(np.float64)
    alone = plan_channel(Stream.LATENT, values, plan.step, weight, classes, count)
    return alone, LatentChain(0, alone.bits, alone.error), values


@contextmanager
def _stages(stages: int) -> Iterator[None]:
    with mock.patch.dict(EFFORTS, {level: replace(effort, stages=stages) for level, effort in EFFORTS.items()}):
        yield


DECIDING: dict[str, Switch] = {
    "RDO rounding": lambda: mock.patch.object(decision, "choose_values", _nearest),
    "aligned steps": lambda: mock.patch.object(plans, "aligned_steps", _unaligned),
    "staggered layers": lambda: mock.patch.object(allocate, "STAGGER", 1.0),
    "position residual": _no_residual,
    "classes (one)": lambda: mock.patch.object(explicit, "MOST_GAUSSIAN_CLASSES", 1),
    "half of the classes": lambda: mock.patch.object(allocate, "IMPORTANCE_RATIO", 81.0),
    "LATENT channel": lambda: _latent(_no_channel),
    "codewords": lambda: _latent(_no_codewords),
    "second RVQ stage": lambda: _stages(1),
}
"""Ways to decide that lack something."""
OF_LATENTS = ("LATENT channel", "codewords", "second RVQ stage")
"""Mechanisms of latents, which scenes without view-dependent colour never use."""


# Both


STUDIES = {"coding": coding, "deciding": deciding}


@dataclass(frozen=True)
class Job:
    """A study of a scene."""

    scene: str
    study: str
    effort: int


def run(job: Job) -> list[tuple[str, Record]]:
    """All figures of a job."""
    found = STUDIES[job.study](chosen([job.scene])[0], job.effort)
    return [(f"{job.scene} | {name}", {"scene": job.scene, "mechanism": name, **record}) for name, record in found]


def _measure(jobs: Sequence[Job], results: dict[str, Any], workers: int, keep: bool) -> None:
    began, spawn = time.perf_counter(), multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=spawn, max_tasks_per_child=1) as pool:
        pending = {pool.submit(run, job): job for job in jobs}
        for future in as_completed(pending):
            job, found = pending[future], dict(future.result())
            results.setdefault(job.study, {}).update(found)
            save_results(NAME, results, keep, [f"{job.study}/{key}" for key in found])
            print(f"{time.perf_counter() - began:5.0f} s  {job.scene}, {job.study}", file=sys.stderr, flush=True)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    parser.add_argument("--study", nargs="+", choices=STUDIES, default=list(STUDIES))
    parser.add_argument("--report", action="store_true", help="only rewrite docs/mechanisms.md")
    parser.add_argument("--workers", type=int, default=1)
    arguments = parser.parse_args()
    keep = not arguments.no_write
    results = load_results(NAME) if keep or arguments.report else {}
    if not arguments.report:
        scenes = chosen(arguments.scenes or (SCENES[:1] if arguments.short else SCENES))
        effort = SHORT_EFFORT if arguments.short else EFFORT
        jobs = [Job(scene.name, study, effort) for scene in scenes for study in arguments.study]
        _measure(jobs, results, arguments.workers, keep)
    if keep:
        write_page(results)
    else:
        print("\n\n".join(texts(results).values()))


if __name__ == "__main__":
    main()
