"""The explicit profile: any trained 3D Gaussian scene to a :class:`QuantisedScene` (encoder side)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from reference_encoder.decide.allocate import classify
from reference_encoder.decide.assemble import BASE_SHARE, final_rate, position_bits
from reference_encoder.decide.decision import (
    Decision,
    Plans,
    Problem,
    best_step,
    codebooks,
    contents,
    decide,
    decoder,
    header_fields,
    layer_costs,
    planned,
    split,
    targets,
)
from reference_encoder.decide.lattice import LARGE_SCENE, place
from reference_encoder.decide.layering import Entry, best_looking, first_picture, predicted
from reference_encoder.decide.targets import Targets
from reference_encoder.latent.fit import fit_latent
from reference_encoder.measure.attributes import Attributes, from_scene
from reference_encoder.measure.calibrate import Judge, calibrated
from reference_encoder.measure.reconstruct import reconstructed, rough
from reference_encoder.measure.sensitivity import Sensitivity, measure, survey
from reference_encoder.options import EFFORTS, EncodeOptions
from scarfmt.coding.writer import QuantisedScene, Report, silent
from scarfmt.container.schema import Profile, Stream
from scarfmt.scene.gaussians import GaussianScene

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

CHANNELS = (Stream.SCALE, Stream.ROTATION, Stream.OPACITY, Stream.COLOUR)
COARSEST_STEP: dict[Stream, tuple[float, ...]] = {
    Stream.POSITION_RESIDUAL: (1 / 3, 1 / 3, 1 / 3),
    Stream.SCALE: (0.55, 0.6, 1.0),
    Stream.ROTATION: (0.6, 0.6, 0.9),
    Stream.OPACITY: (1.0,),
    Stream.COLOUR: (1.5, 1.5, 1.8),
}
# The cheapest anchor: a position, a class and first steps.
_CHEAPEST_BITS = 40.0
_MOST_CLASSES = 8
# Errors of shape and of view-dependent colour agree between neighbours more than others do: they count for more
# (docs/decisions/0003-visibility.md).
_REST_SHARE = 1.3
_SHAPE_SHARE = {Stream.SCALE: 1.5, Stream.ROTATION: 1.5}
_LAYER_VIEWS = 3


def encode_explicit(
    scene: GaussianScene, options: EncodeOptions, report: Report = silent
) -> tuple[QuantisedScene, Targets | None]:
    """Decide everything about a file for `scene`, and tell what its codewords are to reproduce."""
    report("visibility", 0.0)
    attributes = from_scene(scene)
    job = _Job(scene, attributes, measure(scene, attributes, survey(scene, options)), options, report)
    report("visibility", 1.0)
    attempt = _calibrated(job)
    problem, decision = attempt.problem, attempt.decision
    if EFFORTS[options.effort].looks_at_layers and options.layers > 1:
        problem, decision = _layered_by_looks(job, attempt)
    quantised = QuantisedScene(
        header_fields(problem, scene.sh_degree, len(scene)),
        decision.model,
        problem.placement.tiles,
        contents(problem, decision),
        codebooks(problem, decision.model),
        decoder(problem, decision.model),
        (),
        dict(options.metadata),
    )
    return quantised, targets(problem, decision)


@dataclass(frozen=True)
class _Job:
    """A scene, and what is known of it whatever the quality."""

    scene: GaussianScene
    attributes: Attributes
    sensitivity: Sensitivity
    options: EncodeOptions
    report: Report

    @cached_property
    def judge(self) -> Judge:
        """Pictures of the source, drawn when they are first wanted."""
        return Judge.of(self.scene, self.options)


@dataclass(frozen=True)
class _Seen:
    """What is left to encode after the invisible is gone."""

    attributes: Attributes
    sensitivity: Sensitivity
    classes: I64
    count: int
    rate: float
    lost: float


@dataclass(frozen=True)
class _Attempt:
    """What one lambda leads to, the first layer as predicted."""

    positions: F64
    problem: Problem
    plans: Plans
    decision: Decision


def _calibrated(job: _Job) -> _Attempt:
    """The attempt whose pictures are about as good as asked for."""
    options, degree = job.options, job.scene.sh_degree
    corrections = EFFORTS[options.effort].corrections if options.corrections is None else options.corrections
    if options.corrections is None and options.effort == 1 and len(job.scene) > LARGE_SCENE:
        corrections = 0  # a third of the time, where the prediction is best

    def judged(tried: _Attempt) -> float:
        job.report("quality", 0.0)
        return job.judge.psnr_db(reconstructed(tried.positions, degree, tried.problem, tried.decision))

    return calibrated(options.quality, corrections, partial(_attempt, job), judged)


def _attempt(job: _Job, aim: float) -> _Attempt:
    """What is decided at the lambda that is predicted to give `aim` dB."""
    absence = job.sensitivity.absence
    rate = final_rate(aim, len(job.scene))
    classes, count = classify(absence, rate, _CHEAPEST_BITS, _MOST_CLASSES)
    kept = np.flatnonzero(classes >= 0)
    lost = float(absence[classes < 0].sum())
    seen = _Seen(job.attributes.take(kept), job.sensitivity.take(kept), classes[kept], count, rate, lost)
    problem = _problem(seen, job.scene.sh_degree, job.options, job.report)
    job.report("allocate", 0.0)
    plans = planned(problem)
    choices = predicted(layer_costs(problem, plans), problem.base_share, job.options.layers)
    decision = decide(problem, plans, choices)
    job.report("allocate", 1.0)
    return _Attempt(seen.attributes.positions, problem, plans, decision)


def _layered_by_looks(job: _Job, attempt: _Attempt) -> tuple[Problem, Decision]:
    """What `attempt` decided, but for layers that are best by their looks."""
    problem, plans, options = attempt.problem, attempt.plans, job.options
    judge = job.judge.fewer(_LAYER_VIEWS)

    def look(entries: Sequence[Entry], part: float = 1.0) -> float:
        job.report("layers", 0.0)
        return judge.psnr_db(rough(attempt.positions, job.scene.sh_degree, problem, plans, entries, part))

    first = first_picture(layer_costs(problem, plans), look, options.quality, problem.base_share)
    if first.part < 1:
        problem, first = split(problem, first.shown - 1, first.part), replace(first, part=1.0)
        plans = planned(problem)
    choices = best_looking(layer_costs(problem, plans), look, first, options.layers)
    job.report("layers", 1.0)
    return problem, decide(problem, plans, choices)


def _problem(seen: _Seen, degree: int, options: EncodeOptions, report: Report) -> Problem:
    attributes, classes, rate = seen.attributes, seen.classes, seen.rate
    weights = {stream: _SHAPE_SHARE.get(stream, 1.0) * s for stream, s in seen.sensitivity.channels.items()}
    wanted = best_step(weights[Stream.POSITION_RESIDUAL][:, 0], rate)
    placement = place(attributes.positions, wanted, options.tile_anchors)
    weights[Stream.POSITION_RESIDUAL] = weights[Stream.POSITION_RESIDUAL] * (placement.cell**2)[:, None]
    latent, rvq = None, None
    if degree:
        weight = seen.sensitivity.colour * _REST_SHARE
        latent, rvq = fit_latent(attributes.rest, weight, classes, rate, 0, options, report)
    values = {Stream.POSITION_RESIDUAL: placement.residual}
    for stream in CHANNELS:
        values[stream] = attributes.channel(stream)
    fixed = position_bits(classes, seen.count)
    return Problem(
        Profile.EXPLICIT,
        1,
        placement,
        values,
        weights,
        COARSEST_STEP,
        latent,
        rvq,
        classes,
        seen.count,
        rate,
        seen.sensitivity.absence,
        lambda _: fixed,
        seen.lost,
        BASE_SHARE,
    )
