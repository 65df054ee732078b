"""The pipeline of the encoder: from a scene to the bytes of a file, stage by stage (nothing here is normative).

    stage             hands on    what is decided                                       in
    measured          Profile     nothing: what an error in each value shows            measure, profiles
    attempted         Attempt     at one lambda, what `quality` is predicted to need:
      .problem        Problem     classes, tiles and cells, latent and codewords        profiles, decide, latent
      planned         Plans       nothing: what each step of each class costs, gains    decide/plans.py
      predicted       choices     what each layer shows                                 decide/layering.py
      decide          Decision    steps, contexts, the integers of all channels         decide/decision.py
    calibrated        Attempt     lambda, by pictures of the result                     judge/calibrate.py
    layered           Attempt     what each layer shows, by pictures of layers          decide/layering.py
    .finish           Quantised   all integers of the file                              profiles, decide/assemble.py
    smallest_file     bytes       which networks the file gets                          networks

One currency runs through all of it: lambda, squared picture error per bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec

from reference_encoder.decide.assemble import Quantised
from reference_encoder.decide.decision import Decision, decide
from reference_encoder.decide.layering import (
    Entry,
    Look,
    best_looking,
    first_picture,
    likely_first,
    predicted,
    predicted_after,
)
from reference_encoder.decide.plans import Plans, layer_costs, planned
from reference_encoder.decide.problem import Problem
from reference_encoder.judge.calibrate import calibrated
from reference_encoder.judge.reconstruct import reconstructed, rough
from reference_encoder.networks.file_costs import index_bytes, latent_cost, within_limits
from reference_encoder.options import EFFORTS, EncodeOptions
from reference_encoder.profiles.explicit import ExplicitProfile
from reference_encoder.profiles.profile import Profile
from reference_encoder.tuning import FIRST_CAP_DB, LARGE_SCENE
from scarfmt.coding.writer import Report, silent, write_scene
from scarfmt.engines import best_engine
from scarfmt.errors import InvalidInput, missing_package
from scarfmt.scene.gaussians import AnchorModel, GaussianScene


@dataclass(frozen=True)
class Attempt:
    """What one lambda leads to.

    Attributes:
        problem: what there was to decide.
        plans: what it costs.
        decision: what was decided.
    """

    problem: Problem
    plans: Plans
    decision: Decision


def encoded(scene: GaussianScene | AnchorModel, options: EncodeOptions, report: Report = silent) -> bytes:
    """The bytes of a file for `scene`, all stages one after another.

    Raises:
        InvalidInput: ``input-dependency`` where torch is needed and missing, ``input-anchors``.
    """
    return smallest_file(quantised(scene, options, report), options, report)


def quantised(scene: GaussianScene | AnchorModel, options: EncodeOptions, report: Report = silent) -> Quantised:
    """Everything that is decided about a scene before any network."""
    check_torch(scene, options)
    profile = measured(scene, options, report)
    attempt = layered(profile, calibrated_attempt(profile))
    return profile.finish(attempt.problem, attempt.decision)


def check_torch(scene: GaussianScene | AnchorModel, options: EncodeOptions) -> None:
    """Check that torch is there if `options` or the scene need it: before the work, not after it.

    Raises:
        InvalidInput: ``input-dependency``, and what does without.
    """
    anchors = isinstance(scene, AnchorModel)
    if not (anchors or options.needs_torch) or find_spec("torch") is not None:
        return
    missing = missing_package("torch", "neural")
    if anchors:
        advice = "the networks of an anchor model cannot be measured without"
    elif options.latent == "learned":
        advice = "or leave out --latent learned"
    else:
        advice = "or use --effort 1 or --decode-budget 0, which train no networks"
    raise InvalidInput(missing.refusal, f"{missing.message}; {advice}")


def measured(scene: GaussianScene | AnchorModel, options: EncodeOptions, report: Report) -> Profile:
    """The scene, and what an error in each of its values shows."""
    if isinstance(scene, AnchorModel):
        from reference_encoder.profiles.anchors import AnchorProfile  # needs torch

        return AnchorProfile.measured(scene, options, report)
    return ExplicitProfile.measured(scene, options, report)


def attempted(profile: Profile, quality: float) -> Attempt:
    """What is decided at the lambda that is predicted to give `quality` dB, layers as predicted."""
    problem = profile.problem(quality)
    profile.report("allocate", 0.0)
    plans = planned(problem)
    choices = predicted(layer_costs(problem, plans), problem.budget.base_share, profile.options.layers)
    decision = decide(problem, plans, choices)
    profile.report("allocate", 1.0)
    return Attempt(problem, plans, decision)


def calibrated_attempt(profile: Profile) -> Attempt:
    """The attempt whose pictures are about as good as asked for, or the predicted one where none can be drawn."""
    options, judge = profile.options, profile.judge
    if judge is None:
        return attempted(profile, options.quality)

    def judged(tried: Attempt) -> float:
        profile.report("quality", 0.0)
        return judge.psnr_db(reconstructed(tried.problem, tried.decision))

    corrections = allowed_corrections(options, profile.source_count)
    return calibrated(options.quality, corrections, lambda aim: attempted(profile, aim), judged)


def allowed_corrections(options: EncodeOptions, source_count: int) -> int:
    """How often lambda may be corrected: as asked for, or by effort."""
    effort = EFFORTS[options.effort]
    if options.corrections is not None:
        return options.corrections
    # At effort 1 a third of the time, where the prediction is best.
    return effort.corrections if effort.corrects_large_scenes or source_count <= LARGE_SCENE else 0


def layered(profile: Profile, attempt: Attempt) -> Attempt:
    """The attempt with a first layer without holes, and others after it; as it is where none can be drawn."""
    problem, plans, options = attempt.problem, attempt.plans, profile.options
    if profile.judge is None or options.layers == 1:
        return attempt
    share, costs = problem.budget.base_share, layer_costs(problem, plans)
    looking = EFFORTS[options.effort].looks_at_layers
    first = (
        first_picture(costs, _look(profile, problem, plans, FIRST_CAP_DB), options.quality, share)
        if looking
        else likely_first(costs, share)
    )
    if min(first.parts) < 1:
        problem, first = problem.split(first.parts), replace(first, parts=(1.0,) * first.shown)
        plans = planned(problem)
    costs = layer_costs(problem, plans)
    choices = (
        best_looking(costs, _look(profile, problem, plans, options.quality), first, options.layers)
        if looking
        else predicted_after(first, costs, options.layers)
    )
    profile.report("layers", 1.0)
    return Attempt(problem, plans, decide(problem, plans, choices))


def _look(profile: Profile, problem: Problem, plans: Plans, most: float) -> Look:
    """Looks at layers, each view counting as at most `most` dB."""

    def decibels(entries: Sequence[Entry], parts: Sequence[float]) -> float:
        profile.report("layers", 0.0)
        assert profile.looks is not None
        return profile.looks.psnr_db(rough(problem, plans, entries, parts), most)

    return decibels


def smallest_file(plain: Quantised, options: EncodeOptions, report: Report = silent) -> bytes:
    """The bytes of the smallest file found: up to three are written, and the first is the one without networks.

    Predictors of channel values come first, each only if it saves more than it takes; then the index network. With it,
    codewords are chosen again at its prices, if there are targets to choose by. The network stays if what it codes and
    its own blocks cost less than indices under static tables, by bits and error together; and if then the file as a
    whole is not smaller, the static one is returned.

    Args:
        plain: all integers, under static tables only.
        options: `decode_budget` bounds what is tried; of `effort`, 1 tries nothing, and 3 several networks.
        report: told (stage, fraction done).
    """
    static = write_scene(plain.scene, report, best_engine())
    if not options.trains_networks:
        return static
    from reference_encoder.networks.candidates import affordable_predictors, with_index_network, with_rounds

    predicted_scene = affordable_predictors(plain.scene, options, report)
    learned = with_index_network(predicted_scene or plain.scene, options, report)
    if learned is not None and learned.bits < 8 * index_bytes(static):
        if plain.targets is not None:
            learned = with_rounds(learned, plain.targets, options, report)
        data, neural = write_scene(learned.scene, report, best_engine()), replace(plain, scene=learned.scene)
        if latent_cost(neural, data) < latent_cost(plain, static):
            return _smaller(static, data)
    return static if predicted_scene is None else _smaller(static, write_scene(predicted_scene, report, best_engine()))


def _smaller(static: bytes, neural: bytes) -> bytes:
    """The file with networks if it is smaller and readers take it."""
    return neural if len(neural) < len(static) and within_limits(neural) else static
