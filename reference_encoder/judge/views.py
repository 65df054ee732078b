"""The views that results are judged by, and reported by: none of the survey's, from the same places (encoder only)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import IntEnum

from reference_encoder.options import EFFORTS, EncodeOptions
from reference_encoder.tuning import LEAST_JUDGED_VIEWS, SAMPLED_EVERY
from scarfmt.render.camera import Camera
from scarfmt.render.viewpoints import KINDS, Surroundings, viewpoints
from scarfmt.scene.gaussians import GaussianScene


class Sight(IntEnum):
    """What views are for. Views of different numbers have nothing in common but the distribution."""

    SURVEY = 0
    LOOP = 1
    REPORT = 2


def judged_views(
    scene: GaussianScene, options: EncodeOptions, sight: Sight, count: int
) -> Mapping[str, Sequence[Camera]]:
    """Kind -> views of one set, as many of each kind; one pixel of each 8x8 of 640x480 pictures.

    Args:
        scene: whose positions say where people may stand.
        options: `seed`, `effort`, `frame`.
        sight: which set.
        count: Gaussians that are drawn.
    """
    around, views = Surroundings.of(scene, options.frame), views_of_kind(options, count)
    seed = options.seed * len(Sight) + sight
    return {kind: [camera.sampled(SAMPLED_EVERY) for camera in viewpoints(around, kind, views, seed)] for kind in KINDS}


def views_of_kind(options: EncodeOptions, count: int) -> int:
    """Views of each kind for a scene of `count` Gaussians: what the effort has, fewer in large scenes."""
    effort = EFFORTS[options.effort]
    return min(effort.judged_views, max(LEAST_JUDGED_VIEWS, effort.judged_gaussians // max(count, 1)))
