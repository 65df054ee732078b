"""The views that stand for wherever somebody may look from, to measure from or to judge by (encoder only, informative).

Views of every kind of :mod:`scarfmt.render.viewpoints`, many and small; cameras that are given stand beside them, with
their neighbourhood (docs/decisions/0023-survey-of-everywhere.md). Those that results are judged by, and reported by,
are none of the survey's, from the same places.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

from reference_encoder.options import EFFORTS, EncodeOptions
from reference_encoder.tuning import (
    BESIDE_SHARE,
    CLOSE_DEG,
    CLOSE_PART,
    GIVEN_SHARE,
    HELD_OUT_SEED,
    JITTER_DEG,
    JITTER_PART,
    JUDGED_SAMPLES,
    JUDGED_SHARES,
    KIND_SHARES,
    LEAST_JUDGED_VIEWS,
    LOCAL_GAUSSIANS,
    LOW_VIEWS,
    MOST_LOCAL_VIEWS,
    ORBIT_PART,
    SURVEY_SAMPLES,
    SURVEY_SEED,
    TUNING_SEED,
)
from scarfmt.render.camera import Camera
from scarfmt.render.viewpoints import KINDS, Surroundings, Upright, beside, resolved, viewpoints
from scarfmt.scene.gaussians import GaussianScene

GIVEN, BESIDE = "given", "beside"
"""Kinds of views that cameras add: themselves, and their neighbourhood."""


class ViewSet(IntEnum):
    """The purposes of views that judge; the value is the seed. Views of two seeds share only their distribution."""

    TUNING = TUNING_SEED
    HELD_OUT = HELD_OUT_SEED


@dataclass(frozen=True)
class Views:
    """Views to measure from, or to judge by.

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
        """All views, kind after kind."""
        return [camera for cameras in self.views.values() for camera in cameras]

    def thinned(self, most: int) -> Views:
        """All given cameras, and of each other kind some, about `most` together."""
        others = sum(len(cameras) for kind, cameras in self.views.items() if kind != GIVEN)
        every = max(1, -(-others // most))
        views = {kind: cameras if kind == GIVEN else cameras[::every] for kind, cameras in self.views.items()}
        return replace(self, views=views)


def sample_views(scene: GaussianScene, options: EncodeOptions, count: int | None = None) -> Views:
    """The views of a scene: from everywhere, from the given cameras and beside them, or from these alone.

    Where it is doubtful which way is up, half of those from everywhere are for either guess.

    Args:
        scene: all of it, or Gaussians drawn evenly from it.
        options: `effort`, `frame`, `cameras`, `only_cameras`.
        count: Gaussians of the whole scene; None where these are all.

    Raises:
        InvalidInput: ``input-frame``; ``input-empty`` if no position is finite.
    """
    up, given = resolved(scene, options.frame), _given(options)
    around = Surroundings.of(scene, up.up)
    if options.only_cameras:
        return Views({GIVEN: _sample_pixels(given, SURVEY_SAMPLES)}, {GIVEN: 1.0}, around.radius, up)
    counts = count_views(options.effort, count or len(scene))
    everywhere = _everywhere(scene, around, up, counts, SURVEY_SEED, SURVEY_SAMPLES)
    if not given:
        return Views(everywhere, KIND_SHARES, around.radius, up)
    near = _sample_pixels(beside(given, JITTER_PART * around.radius, JITTER_DEG, SURVEY_SEED), SURVEY_SAMPLES)
    known = {GIVEN: _sample_pixels(given, SURVEY_SAMPLES), BESIDE: near}
    return Views({**known, **everywhere}, _shares_with_given(KIND_SHARES), around.radius, up)


def judging_views(scene: GaussianScene, options: EncodeOptions, up: Upright, view_set: ViewSet, count: int) -> Views:
    """One set of views, distributed as those of the survey; in place of given cameras, others very close to them.

    Args:
        scene: whose positions say where people may stand.
        options: `effort`, `cameras`, `only_cameras`.
        up: where that is doubtful, half of the views from everywhere are for either guess, as in the survey.
        view_set: which set.
        count: Gaussians that are drawn.
    """
    around, views, given = Surroundings.of(scene, up.up), views_of_kind(options, count), _given(options)
    everywhere = _everywhere(scene, around, up, dict.fromkeys(KINDS, views), view_set, JUDGED_SAMPLES)
    if not given:
        return Views(everywhere, JUDGED_SHARES, around.radius, up)
    given = [given[number * len(given) // views] for number in range(views)]
    close = _sample_pixels(beside(given, CLOSE_PART * around.radius, CLOSE_DEG, view_set), JUDGED_SAMPLES)
    if options.only_cameras:
        return Views({GIVEN: close}, {GIVEN: 1.0}, around.radius, up)
    near = _sample_pixels(beside(given, JITTER_PART * around.radius, JITTER_DEG, view_set), JUDGED_SAMPLES)
    known = {GIVEN: close, BESIDE: near}
    return Views({**known, **everywhere}, _shares_with_given(JUDGED_SHARES), around.radius, up)


def _given(options: EncodeOptions) -> list[Camera]:
    """The cameras that count: those of photos for tests only where there are no others."""
    cameras = options.cameras or ()
    return [camera for camera in cameras if camera.split != "test"] or list(cameras)


def _everywhere(
    scene: GaussianScene, around: Surroundings, up: Upright, counts: Mapping[str, int], seed: int, samples: int
) -> dict[str, list[Camera]]:
    """So many views of each kind, about `samples` pixels of each; half for either guess which way is up."""
    every = [around] if up.other is None else [around, Surroundings.of(scene, up.other)]
    return {
        kind: _sample_pixels(
            [view for each in every for view in viewpoints(each, kind, -(-count // len(every)), seed)], samples
        )
        for kind, count in counts.items()
    }


def _shares_with_given(kinds: Mapping[str, float]) -> dict[str, float]:
    """How much each kind counts beside given cameras."""
    rest = 1 - GIVEN_SHARE - BESIDE_SHARE
    return {GIVEN: GIVEN_SHARE, BESIDE: BESIDE_SHARE, **{kind: rest * part for kind, part in kinds.items()}}


def _sample_pixels(cameras: Sequence[Camera], samples: int) -> list[Camera]:
    """About so many pixels of each view."""
    every = [max(1, round(math.sqrt(camera.width * camera.height / samples))) for camera in cameras]
    return [camera.sampled(step) for camera, step in zip(cameras, every, strict=True)]


def count_views(effort: int, gaussians: int) -> dict[str, int]:
    """Views of each kind. From outside everything is seen at once; what is seen from near grows with what there is."""
    views = EFFORTS[effort].survey_views
    outside = round(ORBIT_PART * views)
    local = min(round((views - outside) * max(1.0, gaussians / LOCAL_GAUSSIANS)), MOST_LOCAL_VIEWS)
    return {"orbit": outside, "near": local // 2, "inside": local - local // 2}


def views_of_kind(options: EncodeOptions, count: int) -> int:
    """Views of each kind that judge a scene of `count` Gaussians: what the effort has, fewer in large scenes; more for
    a percentile."""
    effort = EFFORTS[options.effort]
    views = min(effort.judged_views, max(LEAST_JUDGED_VIEWS, effort.judged_gaussians // max(count, 1)))
    return views if options.worst is None else LOW_VIEWS * views
