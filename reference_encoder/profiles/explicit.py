"""The explicit profile: any trained 3D Gaussian scene (SPEC §9; encoder side)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from reference_encoder.decide.allocate import classify, ranked_with_colour
from reference_encoder.decide.assemble import Quantised, assembled
from reference_encoder.decide.decision import Decision
from reference_encoder.decide.lagrangian import best_width, lambda_for
from reference_encoder.decide.lattice import Placement, place
from reference_encoder.decide.plans import position_bits
from reference_encoder.decide.problem import Budget, Channels, Classes, Geometry, Problem, standing
from reference_encoder.judge.finished import finished_gaussians
from reference_encoder.judge.judge import Judge, gaussian_view
from reference_encoder.judge.looks import Looks
from reference_encoder.judge.quality import most_db
from reference_encoder.judge.views import Sight, judged_views
from reference_encoder.latent.fit import FittedLatent, Wanted, fit_latent
from reference_encoder.measure.attributes import Attributes, from_scene, without_hidden_scales
from reference_encoder.measure.sensitivity import Sensitivity, measure
from reference_encoder.measure.survey import Survey, survey
from reference_encoder.measure.weights import Weights, weighed
from reference_encoder.options import EncodeOptions
from reference_encoder.profiles.account import ACCOUNT, account
from reference_encoder.tuning import (
    CLASS_COLOUR_SHARE,
    GAUSSIAN_BASE_SHARE,
    GAUSSIAN_BITS,
    GAUSSIAN_COARSEST,
    GAUSSIAN_LAMBDA_DB,
    MOST_GAUSSIAN_CLASSES,
    REST_SHARE,
    SHAPE_SHARE,
)
from scarfmt.arrays import F64, I64
from scarfmt.coding.writer import QuantisedScene, Report, silent
from scarfmt.container import schema
from scarfmt.container.schema import Stream
from scarfmt.scene.gaussians import GaussianScene

_CHANNELS = (Stream.SCALE, Stream.ROTATION, Stream.OPACITY, Stream.COLOUR)


@dataclass(frozen=True)
class ExplicitProfile:
    """A Gaussian scene, and what is known of it whatever the quality; a :class:`Profile`.

    Attributes:
        scene: the source.
        attributes: of all its Gaussians, in the terms of SPEC §9; axes that nobody sees are no shorter than that.
        survey: where they were looked at from.
        weights: what they weigh there.
        sensitivity: what errors in them show.
        options, report: of the encoder; the frame is the one that was found.
    """

    scene: GaussianScene
    attributes: Attributes
    survey: Survey
    weights: Weights
    sensitivity: Sensitivity
    options: EncodeOptions
    report: Report

    @classmethod
    def measured(cls, scene: GaussianScene, options: EncodeOptions, report: Report = silent) -> ExplicitProfile:
        """A scene without NaN or infinity, looked at from the views that matter."""
        report("visibility", 0.0)
        attributes = from_scene(scene)
        views = survey(scene, options)
        weights = weighed(scene, views, lambda part: report("visibility", part))
        attributes = without_hidden_scales(attributes, weights.pixel)
        told = replace(options, frame=views.up.up)
        return cls(scene, attributes, views, weights, measure(attributes, weights), told, report)

    def reweighted(self, shares: Mapping[str, float]) -> ExplicitProfile:
        """Sensitivities in which each kind of view has the weight given by `shares`, whose sum is 1."""
        weights = replace(self.weights, shares=shares)
        return replace(self, weights=weights, sensitivity=measure(self.attributes, weights))

    @property
    def source_count(self) -> int:
        """Gaussians of the source."""
        return len(self.scene)

    def judge(self, sight: Sight) -> Judge[GaussianScene]:
        """Pictures of the source from views of a set, drawn now."""
        views = judged_views(self.scene, self.options, self.survey.up, sight, len(self.scene))
        return Judge.of(self.scene, gaussian_view, views, most_db(self.options.asked_db))

    @property
    def shows_layers(self) -> bool:
        """Whether layers can be drawn."""
        return True

    @cached_property
    def looks(self) -> Looks:
        """Small pictures of the source from everywhere, drawn when they are first wanted."""
        return Looks.of(self.scene, self.options)

    def problem(self, quality: float) -> Problem:
        """The problem of encoding at the lambda predicted to give `quality` dB, with its latent fitted."""
        absence, lambda_ = self.sensitivity.absence, lambda_for(quality, len(self.scene), GAUSSIAN_LAMBDA_DB)
        share = CLASS_COLOUR_SHARE if self.scene.sh_degree else 0.0
        ranked = ranked_with_colour(absence, self.sensitivity.colour, share, lambda_ * GAUSSIAN_BITS)
        every, count = classify(ranked, lambda_, GAUSSIAN_BITS, MOST_GAUSSIAN_CLASSES)
        kept = np.flatnonzero(every >= 0)
        classes, seen, attributes = every[kept], self.sensitivity.take(kept), self.attributes.take(kept)
        placement = place(attributes.positions, wanted_step(seen, lambda_), self.options.tile_anchors)
        channels = channels_of(attributes, seen, placement)
        fixed = position_bits(classes, count)
        return Problem(
            geometry=self._geometry(attributes, placement),
            channels=channels,
            fitted=self._fitted(attributes, seen, classes, lambda_),
            classes=Classes(
                of=classes,
                count=count,
                importance=seen.absence,
                standing=standing(attributes.positions, classes, log_extent(attributes)),
                presence_bits=lambda _: fixed,
            ),
            budget=Budget(lambda_=lambda_, lost=float(absence[every < 0].sum()), base_share=GAUSSIAN_BASE_SHARE),
        )

    def _geometry(self, attributes: Attributes, placement: Placement) -> Geometry:
        return Geometry(
            profile=schema.Profile.EXPLICIT,
            slots=1,
            sh_degree=self.scene.sh_degree,
            source_count=len(self.scene),
            positions=attributes.positions,
            placement=placement,
        )

    def _fitted(self, attributes: Attributes, seen: Sensitivity, classes: I64, lambda_: float) -> FittedLatent | None:
        """The latent of view-dependent colour; None at degree 0."""
        if not self.scene.sh_degree:
            return None
        weight = seen.colour * REST_SHARE
        wanted = Wanted(vectors=attributes.rest, weight=weight, classes=classes, lambda_=lambda_)
        return fit_latent(wanted, self.options, self.report)

    def finish(self, problem: Problem, decision: Decision) -> Quantised:
        """All integers of the file that `decision` says."""
        lambda_, absence = problem.budget.lambda_, self.sensitivity.absence
        left_out = classify(absence, lambda_, GAUSSIAN_BITS, MOST_GAUSSIAN_CLASSES)[0] < 0
        told = account(self.survey, self.weights.largest, left_out, decision, self.scene.sh_degree > 0)
        return assembled(problem, decision, {ACCOUNT: told, **self.options.metadata})

    def finished(self, scene: QuantisedScene) -> GaussianScene:
        """The scene that a decoder makes of the last layer of a file."""
        return finished_gaussians(scene)


def wanted_step(seen: Sensitivity, lambda_: float) -> F64:
    """(N,) quantiser step of positions that pays, world units."""
    return best_width(seen.channels[Stream.POSITION_RESIDUAL][:, 0], lambda_)


def channels_of(attributes: Attributes, seen: Sensitivity, placement: Placement) -> Channels:
    """The channels of Gaussians that lie there."""
    weights = {stream: SHAPE_SHARE.get(stream, 1.0) * s for stream, s in seen.channels.items()}
    weights[Stream.POSITION_RESIDUAL] = weights[Stream.POSITION_RESIDUAL] * (placement.cell**2)[:, None]
    values = {Stream.POSITION_RESIDUAL: placement.residual, **{s: attributes.channel(s) for s in _CHANNELS}}
    return Channels(values=values, weights=weights, coarsest=GAUSSIAN_COARSEST)


def log_extent(attributes: Attributes) -> F64:
    """(N,) logarithm of what a Gaussian covers: its face, the two longest axes, times its opacity."""
    return np.asarray(attributes.log_scales[:, :2].sum(axis=1) + attributes.log_opacity[:, 0])
