"""The views that results are judged by, and reported by: none of the survey's, from the same places (encoder only)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum

from reference_encoder.importance.view_sampling import BESIDE, GIVEN
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
    LEAST_JUDGED_VIEWS,
    LOW_VIEWS,
    TUNING_SEED,
)
from scarfmt.render.camera import Camera
from scarfmt.render.viewpoints import KINDS, Surroundings, Upright, beside, viewpoints
from scarfmt.scene.gaussians import GaussianScene


class ViewSet(IntEnum):
    """The purposes of views; the value is the seed. Views of two seeds share only their distribution."""

    TUNING = TUNING_SEED
    HELD_OUT = HELD_OUT_SEED


@dataclass(frozen=True)
class Views:
    """Views to judge by.

    Attributes:
        cameras: of each kind.
        shares: how much each kind counts; they add up to 1.
    """

    cameras: Mapping[str, Sequence[Camera]]
    shares: Mapping[str, float]


def judging_views(scene: GaussianScene, options: EncodeOptions, up: Upright, view_set: ViewSet, count: int) -> Views:
    """One set of views, distributed as those of the survey; in place of given cameras, others very close to them.

    Args:
        scene: whose positions say where people may stand.
        options: `effort`, `cameras`, `only_cameras`.
        up: where that is doubtful, half of the views from everywhere are for either guess, as in the survey.
        view_set: which set.
        count: Gaussians that are drawn.
    """
    around, views = Surroundings.of(scene, up.up), views_of_kind(options, count)
    every = [around] if up.other is None else [around, Surroundings.of(scene, up.other)]
    part = -(-views // len(every))
    everywhere = {
        kind: _sample_pixels([view for each in every for view in viewpoints(each, kind, part, view_set)])
        for kind in KINDS
    }
    if not options.cameras:
        return Views(everywhere, JUDGED_SHARES)
    given = [camera for camera in options.cameras if camera.split != "test"] or list(options.cameras)
    given = [given[number * len(given) // views] for number in range(views)]
    close = _sample_pixels(beside(given, CLOSE_PART * around.radius, CLOSE_DEG, view_set))
    if options.only_cameras:
        return Views({GIVEN: close}, {GIVEN: 1.0})
    near = _sample_pixels(beside(given, JITTER_PART * around.radius, JITTER_DEG, view_set))
    rest = 1 - GIVEN_SHARE - BESIDE_SHARE
    shares = {GIVEN: GIVEN_SHARE, BESIDE: BESIDE_SHARE, **{kind: rest * part for kind, part in JUDGED_SHARES.items()}}
    return Views({GIVEN: close, BESIDE: near, **everywhere}, shares)


def views_of_kind(options: EncodeOptions, count: int) -> int:
    """Views of each kind for a scene of `count` Gaussians: what the effort has, fewer in large scenes; more for a
    percentile."""
    effort = EFFORTS[options.effort]
    views = min(effort.judged_views, max(LEAST_JUDGED_VIEWS, effort.judged_gaussians // max(count, 1)))
    return views if options.worst is None else LOW_VIEWS * views


def _sample_pixels(cameras: Sequence[Camera]) -> list[Camera]:
    """About `JUDGED_SAMPLES` pixels of each view."""
    every = [max(1, round(math.sqrt(camera.width * camera.height / JUDGED_SAMPLES))) for camera in cameras]
    return [camera.sampled(step) for camera, step in zip(cameras, every, strict=True)]
