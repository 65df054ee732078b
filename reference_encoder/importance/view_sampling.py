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
from scarfmt.render.camera import Camera, warn_if_much_lies_apart
from scarfmt.render.viewpoints import KINDS, Surroundings, Upright, beside, resolve_frame, viewpoints
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

    def thin(self, most: int) -> Views:
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

    Warns:
        InputWarning: without cameras, most of the scene lies far from where it is looked at.
    """
    if not options.cameras:
        warn_if_much_lies_apart(scene.positions)
    up, counts = resolve_frame(scene, options.frame), count_views(options.effort, count or len(scene))
    given = given_cameras(options)
    return _draw(scene, options, up, given, False, counts, SURVEY_SEED, SURVEY_SAMPLES, KIND_SHARES)


def judging_views(scene: GaussianScene, options: EncodeOptions, up: Upright, view_set: ViewSet, count: int) -> Views:
    """One set of views, distributed as those of the survey; in place of given cameras, others very close to them.

    Args:
        scene: whose positions say where people may stand.
        options: `effort`, `cameras`, `only_cameras`.
        up: where that is doubtful, half of the views from everywhere are for either guess, as in the survey.
        count: Gaussians that are drawn.
    """
    views, given = views_of_kind(options, count), given_cameras(options)
    given = [given[number * len(given) // views] for number in range(views)] if given else []
    counts = dict.fromkeys(KINDS, views)
    return _draw(scene, options, up, given, True, counts, view_set, JUDGED_SAMPLES, JUDGED_SHARES)


def given_cameras(options: EncodeOptions) -> list[Camera]:
    """The cameras that count: those of photos for tests only where there are no others."""
    cameras = options.cameras or ()
    return [camera for camera in cameras if camera.split != "test"] or list(cameras)


def _draw(
    scene: GaussianScene,
    options: EncodeOptions,
    up: Upright,
    given: Sequence[Camera],
    close: bool,
    counts: Mapping[str, int],
    seed: int,
    samples: int,
    shares: Mapping[str, float],
) -> Views:
    """The given cameras, or others very close to them; views beside them; and views from everywhere.

    Args:
        close: whether others stand for the given cameras.
        counts, shares: by kind of those from everywhere: how many, and how much each counts without given cameras.
        samples: pixels of each view, about.
    """
    around = Surroundings.of(scene, up.up)
    here = beside(given, CLOSE_PART * around.radius, CLOSE_DEG, seed) if close and given else given
    views: dict[str, Sequence[Camera]] = {GIVEN: here} if given else {}
    if options.only_cameras:
        shares = {GIVEN: 1.0}
    else:
        if given:
            rest = 1 - GIVEN_SHARE - BESIDE_SHARE
            views[BESIDE] = beside(given, JITTER_PART * around.radius, JITTER_DEG, seed)
            shares = {GIVEN: GIVEN_SHARE, BESIDE: BESIDE_SHARE, **{kind: rest * part for kind, part in shares.items()}}
        every = [around] if up.other is None else [around, Surroundings.of(scene, up.other)]
        for kind, count in counts.items():
            part = -(-count // len(every))
            views[kind] = [view for each in every for view in viewpoints(each, kind, part, seed)]
    return Views({kind: _sample_pixels(found, samples) for kind, found in views.items()}, shares, around.radius, up)


def _sample_pixels(cameras: Sequence[Camera], samples: int) -> list[Camera]:
    """About so many pixels of each view."""
    every = [max(1, round(math.sqrt(camera.width * camera.height / samples))) for camera in cameras]
    return [camera.sample(step) for camera, step in zip(cameras, every, strict=True)]


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
