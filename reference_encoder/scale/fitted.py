"""Decisions for a whole scene, from a sample of it (encoder only; docs/decisions/0044).

Every sum that an allocation compares is one over Gaussians, so a sample that is drawn evenly tells it, times what each
Gaussian of it stands for. What is decided about a Gaussian is a function of its own values, its weight and the Fit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from reference_encoder.decide.allocate import ClassBounds, bounds_of_classes, colour_shift
from reference_encoder.decide.assemble import header_fields
from reference_encoder.decide.decision import decide
from reference_encoder.decide.lagrangian import lambda_for
from reference_encoder.decide.lattice import finest_bits, place_within, usual_tile
from reference_encoder.decide.layering import LayerChoice
from reference_encoder.decide.plans import layer_costs, planned, position_bits
from reference_encoder.decide.problem import Budget, Classes, Geometry, Problem, standing
from reference_encoder.judge.calibrate import Search
from reference_encoder.latent.fit import FittedLatent, Wanted, fit_latent
from reference_encoder.latent.rvq import Prices
from reference_encoder.measure.attributes import Attributes, from_scene, without_hidden_scales
from reference_encoder.measure.sensitivity import Sensitivity, measure
from reference_encoder.options import EncodeOptions
from reference_encoder.pipeline import Laid, allowed_corrections, layered_by_rule
from reference_encoder.profiles.explicit import channels_of, log_extent, wanted_step
from reference_encoder.scale.fit import Fit, LatentFit, ranked
from reference_encoder.scale.glance import Overview
from reference_encoder.scale.judged import quality_of
from reference_encoder.scale.sample import joined_samples
from reference_encoder.scale.steps import Judged, Sample
from reference_encoder.tuning import (
    GAUSSIAN_BASE_SHARE,
    GAUSSIAN_BITS,
    GAUSSIAN_LAMBDA_DB,
    LATTICE_MARGIN_BITS,
    MOST_GAUSSIAN_CLASSES,
    REST_SHARE,
    WORST_BELOW_DB,
)
from scarfmt.arrays import F64, I64
from scarfmt.coding.writer import silent
from scarfmt.container import schema
from scarfmt.limits import MAX_LATTICE_BITS, MAX_TILE_DEPTH


def settled(
    overview: Overview, samples: Sequence[Sample], judge: Callable[[Fit], Sequence[Judged]]
) -> Fit:
    """Decide all at the lambda at which pictures have the quality asked for.

    Args:
        overview: of the scene.
        samples: of all ranges.
        judge: what the ranges `overview.judging` give under a Fit, from the views :attr:`Sight.LOOP`.
    """
    options, sampled = overview.options, Sampled.of(overview, samples)
    start = options.quality if options.worst is None else options.worst + WORST_BELOW_DB
    search = Search(options.asked_db, allowed_corrections(options), start)

    def decibels(fit: Fit) -> float:
        found = quality_of(overview, judge(fit))
        return found.mean_db if options.worst is None else found.low_db

    return search.settled(sampled.fit(search.aim), sampled.fit, decibels)


@dataclass(frozen=True)
class Sampled:
    """A sample of a scene, ready to be decided about.

    Attributes:
        overview: of the scene.
        attributes, sensitivity: of the Gaussians of the sample.
        repeat: how many each stands for.
    """

    overview: Overview
    attributes: Attributes
    sensitivity: Sensitivity
    repeat: float

    @classmethod
    def of(cls, overview: Overview, samples: Sequence[Sample]) -> Sampled:
        """Collect what is fitted to, from the samples of all ranges."""
        whole = joined_samples(samples)
        attributes = without_hidden_scales(from_scene(whole.scene), whole.measured.pixel)
        seen = measure(attributes, whole.measured)
        return cls(overview, attributes, seen, whole.count / len(whole.scene))

    def fit(self, quality: float) -> Fit:
        """Decide all at the lambda that is predicted to give `quality` dB."""
        lambda_ = lambda_for(quality, self.overview.bounds.count, GAUSSIAN_LAMBDA_DB)
        shift, bounds = self._classes(lambda_)
        problem = self._problem(lambda_, shift, bounds)
        laid = _laid(problem, self.overview.options)
        decision = decide(laid.problem, laid.plans, laid.choices)
        return Fit(
            lambda_=lambda_,
            fields=header_fields(problem.geometry),
            model=decision.model,
            classes=bounds,
            shift=shift,
            parts=laid.first.parts,
            root=self.overview.bounds.root,
            tile_anchors=tile_anchors(self.overview),
            latent=_latent_fit(problem),
        )

    def _ranked(self, lambda_: float, shift: float) -> F64:
        return ranked(self.sensitivity, lambda_, shift, self.overview.bounds.sh_degree)

    def _classes(self, lambda_: float) -> tuple[float, ClassBounds]:
        shift = colour_shift(self.sensitivity.absence, self.sensitivity.colour, lambda_ * GAUSSIAN_BITS)
        importance = self._ranked(lambda_, shift)
        return shift, bounds_of_classes(importance, lambda_, GAUSSIAN_BITS, MOST_GAUSSIAN_CLASSES)

    def _problem(self, lambda_: float, shift: float, bounds: ClassBounds) -> Problem:
        every = bounds.classes(self._ranked(lambda_, shift))
        kept = np.flatnonzero(every >= 0)
        classes, seen, attributes = every[kept], self.sensitivity.take(kept), self.attributes.take(kept)
        geometry = self._geometry(attributes, wanted_step(seen, lambda_))
        fixed = self.repeat * position_bits(classes, bounds.count)
        lost = self.repeat * float(self.sensitivity.absence[every < 0].sum())
        return Problem(
            geometry=geometry,
            channels=channels_of(attributes, seen, geometry.placement),
            fitted=self._fitted(attributes, seen, classes, lambda_),
            classes=Classes(
                of=classes,
                count=bounds.count,
                importance=seen.absence,
                standing=standing(attributes.positions, classes, log_extent(attributes)),
                presence_bits=lambda _: fixed,
            ),
            budget=Budget(lambda_=lambda_, lost=lost, base_share=GAUSSIAN_BASE_SHARE),
            repeat=self.repeat,
        )

    def _geometry(self, attributes: Attributes, wanted: F64) -> Geometry:
        bounds = self.overview.bounds
        # Tiles of the sample are as large as those of the scene will be.
        most = max(1, round(tile_anchors(self.overview) / self.repeat))
        bits = finest_bits(attributes.positions, wanted, bounds.root, most) + LATTICE_MARGIN_BITS
        bits = min(max(bits, MAX_TILE_DEPTH), MAX_LATTICE_BITS)
        return Geometry(
            profile=schema.Profile.EXPLICIT,
            slots=1,
            sh_degree=bounds.sh_degree,
            source_count=bounds.count,
            positions=attributes.positions,
            placement=place_within(attributes.positions, wanted, bounds.root, bits, most),
        )

    def _fitted(self, attributes: Attributes, seen: Sensitivity, classes: I64, lambda_: float) -> FittedLatent | None:
        if not self.overview.bounds.sh_degree:
            return None
        wanted = Wanted(
            vectors=attributes.rest,
            weight=seen.colour * REST_SHARE,
            classes=classes,
            lambda_=lambda_,
            repeat=self.repeat,
        )
        return fit_latent(wanted, self.overview.options, silent)


def tile_anchors(overview: Overview) -> int:
    """Most anchors of a tile."""
    return overview.options.tile_anchors or usual_tile(overview.bounds.count)


def _laid(problem: Problem, options: EncodeOptions) -> Laid:
    plans = planned(problem)
    if options.layers > 1:
        return layered_by_rule(problem, plans, options.layers)
    only: LayerChoice = layer_costs(problem, plans).final
    return Laid(problem, plans, [only], only)


def _latent_fit(problem: Problem) -> LatentFit | None:
    """Codebooks, and the prices of their codewords where the sample has chosen them."""
    fitted, classes = problem.fitted, problem.classes
    if fitted is None or fitted.latent.projection is None:
        return None
    prices = []
    for stage, codes in enumerate(fitted.rvq.indices.T):
        found = Prices(len(fitted.rvq.coarse if stage == 0 else fitted.rvq.residual), classes.count)
        found.update(codes.astype(np.int64), classes.of)
        prices.append(found.bits)
    return LatentFit(fitted.latent.projection, fitted.latent.decoder, fitted.books, tuple(prices))
