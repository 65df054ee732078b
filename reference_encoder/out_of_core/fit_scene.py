"""Decisions for a whole scene, from a sample of it (encoder only; docs/decisions/0044).

Every sum that an allocation compares is one over Gaussians, so a sample that is drawn evenly tells it, times what each
Gaussian of it stands for. What is decided about a Gaussian is a function of its own values, its weight and the Fit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from reference_encoder.importance.attributes import visible_attributes
from reference_encoder.importance.sensitivity import estimate_absence, estimate_colour, measure_sensitivity
from reference_encoder.judge.rate_control import converge
from reference_encoder.out_of_core.fit import Fit, LatentFit, rank_gaussians
from reference_encoder.out_of_core.judge import combine_quality
from reference_encoder.out_of_core.measure import concatenate_samples
from reference_encoder.out_of_core.overview import Overview
from reference_encoder.out_of_core.types import Sample
from reference_encoder.profiles.explicit import choose_step, gaussian_input
from reference_encoder.rdo.allocation import allocate, header_fields
from reference_encoder.rdo.classes import find_class_bounds, measure_colour_shift
from reference_encoder.rdo.curves import measure_curves, predict_lambda
from reference_encoder.rdo.lattice import count_lattice_bits, default_tile_size, place
from reference_encoder.rdo.layers import layer_by_rule
from reference_encoder.tuning import GAUSSIAN_BITS, GAUSSIAN_LAMBDA_DB, LATTICE_MARGIN_BITS, MOST_GAUSSIAN_CLASSES
from scarfmt.arrays import F64
from scarfmt.limits import MAX_LATTICE_BITS, MAX_TILE_DEPTH


def fit_scene(overview: Overview, samples: Sequence[Sample], judge: Callable[[Fit], Sequence[F64]]) -> Fit:
    """Decide all at the lambda at which pictures have the quality asked for.

    Args:
        judge: what the ranges `overview.judging_ranges` give under a Fit, from the views :attr:`ViewSet.TUNING`.
    """
    options, sample = overview.options, concatenate_samples(samples)

    def decibels(fit: Fit) -> float:
        found = combine_quality(overview, judge(fit))
        return found.rated_db if options.worst is None else found.low_db

    return converge(options, partial(fit_sample, overview, sample), decibels)


def fit_sample(overview: Overview, sample: Sample, quality: float) -> Fit:
    """Decide all at the lambda that is predicted to give `quality` dB."""
    scene, measured = sample
    repeat = overview.bounds.count / len(scene)  # how many each stands for
    bounds, most = overview.bounds, overview.options.tile_anchors or default_tile_size(overview.bounds.count)
    lambda_ = predict_lambda(quality, bounds.count, GAUSSIAN_LAMBDA_DB)
    shift = measure_colour_shift(estimate_absence(measured), estimate_colour(measured), lambda_ * GAUSSIAN_BITS)
    importance = rank_gaussians(measured, lambda_, shift, bounds.sh_degree)
    classes = find_class_bounds(importance, lambda_, GAUSSIAN_BITS, MOST_GAUSSIAN_CLASSES)
    every = classes.classify(importance)
    kept = np.flatnonzero(every >= 0)
    weights = measured.take(kept)
    attributes = visible_attributes(scene.take(kept), weights.pixel)
    seen = measure_sensitivity(attributes, weights)
    # Tiles of the sample are as large as those of the scene will be.
    positions, wanted, fewer = attributes.positions, choose_step(seen, lambda_), max(1, round(most / repeat))
    bits = count_lattice_bits(positions, wanted, bounds.root, fewer) + LATTICE_MARGIN_BITS
    placement = place(positions, wanted, fewer, bounds.root, min(max(bits, MAX_TILE_DEPTH), MAX_LATTICE_BITS))
    problem = gaussian_input(
        attributes, seen, every[kept], classes.count, placement, lambda_, bounds.count, repeat, bounds.description
    )
    layered = layer_by_rule(problem, measure_curves(problem), overview.options.layers)
    latent = problem.latent
    return Fit(
        lambda_=lambda_,
        fields=header_fields(problem),
        model=allocate(layered.problem, layered.curves, layered.choices).model,
        classes=classes,
        shift=shift,
        parts=layered.first.parts,
        root=bounds.root,
        tile_anchors=most,
        latent=None if latent is None else LatentFit(latent.projection, latent.decoder),
    )
