"""The views that stand for wherever somebody may look from (encoder only, informative).

Views of every kind of :mod:`scarfmt.render.viewpoints`, many and small; cameras that are given stand beside them, with
their neighbourhood (docs/decisions/0023-survey-of-everywhere.md).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from reference_encoder.options import EFFORTS, EncodeOptions
from reference_encoder.tuning import (
    BESIDE_SHARE,
    GIVEN_SHARE,
    JITTER_DEG,
    JITTER_PART,
    KIND_SHARES,
    LOCAL_GAUSSIANS,
    MOST_LOCAL_VIEWS,
    ORBIT_PART,
    SURVEY_SAMPLES,
    SURVEY_SEED,
)
from scarfmt.render.camera import Camera
from scarfmt.render.viewpoints import Surroundings, Upright, beside, resolved, viewpoints
from scarfmt.scene.gaussians import GaussianScene

GIVEN, BESIDE = "given", "beside"
"""Kinds of views that cameras add: themselves, and their neighbourhood."""


@dataclass(frozen=True)
class SurveyViews:
    """Views to measure from.

    Attributes:
        views: of each kind.
        shares: how much each kind counts; they add up to 1.
        radius: of the scene (:class:`Surroundings`), world units.
        up: which way up it was looked at.
    """

    views: Mapping[str, Sequence[Camera]]
    shares: Mapping[str, float]
    radius: float
    up: Upright

    @property
    def cameras(self) -> list[Camera]:
        """All views."""
        return [camera for cameras in self.views.values() for camera in cameras]

    def thinned(self, most: int) -> SurveyViews:
        """All given cameras, and of each other kind some, about `most` together."""
        others = sum(len(cameras) for kind, cameras in self.views.items() if kind != GIVEN)
        every = max(1, -(-others // most))
        views = {kind: cameras if kind == GIVEN else cameras[::every] for kind, cameras in self.views.items()}
        return replace(self, views=views)


def sample_views(scene: GaussianScene, options: EncodeOptions, count: int | None = None) -> SurveyViews:
    """The views of a scene: from everywhere, from the given cameras and beside them, or from these alone.

    Where it is doubtful which way is up, half of those from everywhere are for either guess.

    Args:
        scene: all of it, or Gaussians drawn evenly from it.
        options: `effort`, `frame`, `cameras`, `only_cameras`.
        count: Gaussians of the whole scene; None where these are all.

    Raises:
        InvalidInput: ``input-frame``; ``input-empty`` if no position is finite.
    """
    given = [camera for camera in options.cameras or () if camera.split != "test"] or list(options.cameras or ())
    up = resolved(scene, options.frame)
    around = Surroundings.of(scene, up.up)
    if options.only_cameras:
        return SurveyViews({GIVEN: [sample_pixels(camera) for camera in given]}, {GIVEN: 1.0}, around.radius, up)
    every = [around] if up.other is None else [around, Surroundings.of(scene, up.other)]
    views = {
        kind: [
            sample_pixels(camera)
            for each in every
            for camera in viewpoints(each, kind, -(-count // len(every)), SURVEY_SEED)
        ]
        for kind, count in count_views(options.effort, count or len(scene)).items()
    }
    if not given:
        return SurveyViews(views, KIND_SHARES, around.radius, up)
    near_given = beside(given, JITTER_PART * around.radius, JITTER_DEG, SURVEY_SEED)
    rest = 1 - GIVEN_SHARE - BESIDE_SHARE
    shares = {GIVEN: GIVEN_SHARE, BESIDE: BESIDE_SHARE, **{kind: rest * part for kind, part in KIND_SHARES.items()}}
    known = {GIVEN: list(map(sample_pixels, given)), BESIDE: list(map(sample_pixels, near_given))}
    return SurveyViews({**known, **views}, shares, around.radius, up)


def count_views(effort: int, gaussians: int) -> dict[str, int]:
    """Views of each kind. From outside everything is seen at once; what is seen from near grows with what there is."""
    views = EFFORTS[effort].survey_views
    outside = round(ORBIT_PART * views)
    local = min(round((views - outside) * max(1.0, gaussians / LOCAL_GAUSSIANS)), MOST_LOCAL_VIEWS)
    return {"orbit": outside, "near": local // 2, "inside": local - local // 2}


def sample_pixels(camera: Camera) -> Camera:
    """About `SURVEY_SAMPLES` pixels of a view."""
    return camera.sampled(max(1, round(math.sqrt(camera.width * camera.height / SURVEY_SAMPLES))))
