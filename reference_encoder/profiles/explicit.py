"""The explicit profile: any trained 3D Gaussian scene (SPEC §9; encoder side)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from reference_encoder.importance.attributes import Attributes, visible_attributes
from reference_encoder.importance.sensitivity import (
    Sensitivity,
    estimate_absence,
    estimate_colour,
    measure_sensitivity,
)
from reference_encoder.importance.view_sampling import Views, ViewSet, judging_views, sample_views
from reference_encoder.importance.weights import Weights, weigh_draft, weigh_scene
from reference_encoder.judge.quality import Judge, cap_db, draw_gaussians
from reference_encoder.judge.reconstruct import reconstruct_gaussians
from reference_encoder.options import EncodeOptions
from reference_encoder.rdo.allocation import Allocation, assemble_scene
from reference_encoder.rdo.classes import Classes, classify, rank_by_coverage, rank_with_colour
from reference_encoder.rdo.curves import best_width, position_bits, predict_lambda
from reference_encoder.rdo.latent import Latent, fit_latent
from reference_encoder.rdo.lattice import Placement, place
from reference_encoder.rdo.rdo_input import RdoInput
from reference_encoder.tuning import (
    CLASS_COLOUR_SHARE,
    COARSEST_LATENT,
    GAUSSIAN_BASE_SHARE,
    GAUSSIAN_BITS,
    GAUSSIAN_COARSEST,
    GAUSSIAN_LAMBDA_DB,
    INVISIBLE_WEIGHT,
    MOST_GAUSSIAN_CLASSES,
    REST_SHARE,
    SHAPE_SHARE,
)
from scarfmt.arrays import F64, I64, Floats
from scarfmt.coding.writer import QuantisedScene, Report, silent
from scarfmt.container import schema
from scarfmt.container.schema import Stream
from scarfmt.scene.description import Description
from scarfmt.scene.gaussians import GaussianScene

ENCODE_REPORT = "survey"
"""The member of METADATA that :func:`report_encoding` makes."""


@dataclass(frozen=True)
class ExplicitProfile:
    """A Gaussian scene, and what is known of it whatever the quality; a :class:`Profile`.

    Attributes:
        scene: the source.
        survey: where they were looked at from.
        weights: what they weigh there.
        options, report: of the encoder; the frame is the one that was found.
    """

    previews = True
    reconstruct = staticmethod(reconstruct_gaussians)

    scene: GaussianScene
    survey: Views
    weights: Weights
    options: EncodeOptions
    report: Report

    @classmethod
    def measure(cls, scene: GaussianScene, options: EncodeOptions, report: Report = silent) -> ExplicitProfile:
        """Measure a scene without NaN or infinity, from the views that matter."""
        report("visibility", 0.0)
        views = sample_views(scene, options)
        if views.cameras:
            weights = weigh_scene(scene, views, lambda part: report("visibility", part))
        else:
            weights = weigh_draft(scene, views)
        return cls(scene, views, weights, replace(options, frame=views.up.up), report)

    def judge(self, view_set: ViewSet) -> Judge[GaussianScene]:
        """Pictures of the source from views of a set, drawn now."""
        views = judging_views(self.scene, self.options, self.survey.up, view_set, len(self.scene))
        return Judge.of(self.scene, draw_gaussians, views, cap_db(self.options.asked_db))

    def prepare(self, quality: float) -> RdoInput:
        """What is to be decided at the lambda predicted to give `quality` dB."""
        lambda_ = predict_lambda(quality, len(self.scene), GAUSSIAN_LAMBDA_DB)
        share = CLASS_COLOUR_SHARE if self.scene.sh_degree else 0.0
        absence, colour = estimate_absence(self.weights), estimate_colour(self.weights)
        ranked = rank_with_colour(absence, colour, share, lambda_ * GAUSSIAN_BITS)
        every, count = classify(ranked, lambda_, GAUSSIAN_BITS, MOST_GAUSSIAN_CLASSES)
        kept = np.flatnonzero(every >= 0)
        weights = self.weights.take(kept)
        # Of those that are sent alone, and anew each time: kept, those of all would be a tenth of the peak of memory.
        attributes = visible_attributes(self.scene.take(kept), weights.pixel)
        seen = measure_sensitivity(attributes, weights)
        placement = place(attributes.positions, choose_step(seen, lambda_), self.options.tile_anchors)
        return gaussian_input(
            attributes, seen, every[kept], count, placement, lambda_, len(self.scene), 1.0, self.scene.description
        )

    def quantise(self, problem: RdoInput, allocation: Allocation) -> QuantisedScene:
        """All integers of the file of an allocation."""
        absence, largest = estimate_absence(self.weights), self.weights.largest
        left_out = classify(absence, problem.lambda_, GAUSSIAN_BITS, MOST_GAUSSIAN_CLASSES)[0] < 0
        invisible = largest < INVISIBLE_WEIGHT
        gone = int((left_out & invisible).sum()), int((left_out & ~invisible).sum())
        scene = assemble_scene(problem, allocation, {})
        plain = sum(int((~view_dependent(scene)[content.classes]).sum()) for content in scene.contents)
        report = report_encoding(self.survey, gone, plain if self.scene.sh_degree else None)
        said = self.scene.description.metadata()
        return replace(scene, metadata={ENCODE_REPORT: report, **said, **self.options.metadata})


def gaussian_input(
    attributes: Attributes,
    seen: Sensitivity,
    classes: I64,
    count: int,
    placement: Placement,
    lambda_: float,
    source_count: int,
    repeat: float,
    description: Description,
) -> RdoInput:
    """What is to be decided about N Gaussians that are worth sending.

    Args:
        classes: (N,) class of each, of `count`.
        placement: their cells and tiles.
        lambda_: of the last layer, squared picture error per bit.
        source_count: Gaussians of the whole source.
        repeat: how many Gaussians each stands for.
        description: of the whole source.
    """
    fixed = repeat * position_bits(classes, count)
    latent = fit_latent(attributes.rest, seen.colour * REST_SHARE, lambda_ * len(classes))
    values, weights, coarsest = gaussian_channels(attributes, seen, placement, latent)
    return RdoInput(
        profile=schema.Profile.EXPLICIT,
        slots=1,
        sh_degree=attributes.sh_degree,
        source_count=source_count,
        positions=attributes.positions,
        placement=placement,
        values=values,
        weights=weights,
        coarsest=coarsest,
        latent=latent,
        classes=Classes(
            of=classes,
            count=count,
            importance=seen.absence,
            coverage_rank=rank_by_coverage(attributes.positions, classes, log_extent(attributes)),
            presence_bits=lambda _: fixed,
        ),
        lambda_=lambda_,
        base_share=GAUSSIAN_BASE_SHARE,
        repeat=repeat,
        description=description,
    )


def choose_step(seen: Sensitivity, lambda_: float) -> F64:
    """(N,) quantiser step of positions that pays, world units."""
    return best_width(seen.channels[Stream.POSITION_RESIDUAL][:, 0], lambda_)


def gaussian_channels(
    attributes: Attributes, seen: Sensitivity, placement: Placement, latent: Latent | None
) -> tuple[dict[Stream, Floats], dict[Stream, F64], dict[Stream, tuple[float, ...]]]:
    """Values, weights and coarsest steps of the channels of Gaussians that lie there, in coding order."""
    values: dict[Stream, Floats] = {
        Stream.POSITION_RESIDUAL: placement.residual,
        Stream.SCALE: attributes.log_scales,
        Stream.ROTATION: attributes.rotation,
        Stream.OPACITY: attributes.log_opacity,
        Stream.COLOUR: attributes.colour,
    }
    weights = {stream: SHAPE_SHARE.get(stream, 1.0) * s for stream, s in seen.channels.items()}
    weights[Stream.POSITION_RESIDUAL] = weights[Stream.POSITION_RESIDUAL] * (placement.cell**2)[:, None]
    coarsest = dict(GAUSSIAN_COARSEST)
    if latent is not None:
        values[Stream.LATENT], weights[Stream.LATENT] = latent.values, latent.weight[:, None]
        coarsest[Stream.LATENT] = (COARSEST_LATENT,) * latent.values.shape[1]
    return values, weights, coarsest


def log_extent(attributes: Attributes) -> F64:
    """(N,) logarithm of what a Gaussian covers: its face, the two longest axes, times its opacity."""
    return np.asarray(attributes.log_scales[:, :2].sum(axis=1) + attributes.log_opacity[:, 0])


def view_dependent(scene: QuantisedScene) -> np.ndarray:
    """(classes,) whether each class of an explicit file has any colour beyond degree 0."""
    index, last = scene.model.channel_index(Stream.LATENT), scene.model.layers[-1]
    return np.array([index is not None and steps[index] > 0 for steps in last.steps])


def report_encoding(survey: Views, left_out: tuple[int, int], plain: int | None) -> dict[str, Any]:
    """JSON-able member of METADATA: how the scene was looked at, and what of it is not in the file as it was.

    Args:
        left_out: Gaussians that are invisible, and others that are too faint.
        plain: Gaussians that lost their view-dependent colour; None where the source has none.
    """
    found: dict[str, Any] = {
        "up": survey.up.up,
        "up_detected": not survey.up.given,
        "radius": float(f"{survey.radius:.3g}"),
        "views": {kind: len(cameras) for kind, cameras in survey.views.items()},
        "left_out": {"invisible": left_out[0], "faint": left_out[1]},
    }
    if survey.up.other is not None:
        found["up_or"] = survey.up.other
    if plain is not None:
        found["without_view_dependence"] = plain
    return found
