"""Weights of the Gaussians of one range in pictures of the whole scene (encoder only; docs/decisions/0044).

A Gaussian's weight is a power mean over views, most of which is told by the few that are near. Views are drawn with a
chance in proportion to the part of it that each tells, and count as many times as they were unlikely: the sum over all
views is expected to be right, and varies much less than that over views drawn evenly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from reference_encoder.importance.weights import Weights, WeightSums, weigh_draft, weigh_unoccluded
from reference_encoder.out_of_core.overview import Overview, sample_evenly
from reference_encoder.out_of_core.types import Range, Sample
from reference_encoder.tuning import (
    CLASS_COLOUR_SHARE,
    FLOOR_DISTANCE,
    IMPORTANCE_RATIO,
    MEETING_ROWS,
    RANGE_ORBITS,
    RANGE_VIEWS,
    SAMPLE_ROWS,
    SURVEY_POWER,
)
from scarfmt.arrays import F64, I64
from scarfmt.render.camera import Camera
from scarfmt.render.projection import Drawable
from scarfmt.render.rasterise import Contributions, contributions_by_view
from scarfmt.scene.gaussians import GaussianScene, concatenate

_REACH = 3.0
"""Deviations of a splat that a picture may show."""


def sample_views(shares: F64, most: int) -> tuple[I64, F64]:
    """At most so many views, spread over all, and how many each stands for.

    Args:
        shares: (V,) parts of the whole that views tell (:func:`estimate_shares`), in any unit; of 0, none is drawn.
        most: views, at least 1.

    Returns:
        (n,) rising numbers of views, (n,) at least 1.
    """
    chance = np.minimum(shares > 0, 1.0)
    if chance.sum() > most:
        chance = _chances(shares, most)
    # One view for every whole number that the sum of chances passes by.
    passed = np.floor(np.cumsum(chance) + 0.5 + 1e-9)
    chosen = np.flatnonzero(np.diff(passed, prepend=0.0) > 0)
    return chosen, 1 / chance[chosen]


def _chances(shares: F64, most: int) -> F64:
    """(V,) in proportion to shares, none above 1, that add up to `most`; fewer shares than that are 0."""
    sure = np.zeros(len(shares), bool)
    while True:
        rest = np.where(sure, 0.0, shares)
        chance = np.where(sure, 1.0, rest * ((most - sure.sum()) / rest.sum()))
        more = (chance >= 1) & ~sure
        if not more.any():
            return chance
        sure |= more


def estimate_shares(scene: GaussianScene, cameras: Sequence[Camera]) -> F64:
    """(V,) part of the weights of Gaussians that each of V views tells, were nothing in front of them: their mean."""
    if not cameras:
        return np.zeros(0)
    shown = np.stack([_measure_alone(scene, camera) for camera in cameras])
    whole = shown.sum(axis=0)
    seen = whole > 0
    return np.asarray((shown[:, seen] / whole[seen]).sum(axis=1) / max(int(seen.sum()), 1))


def _measure_alone(scene: GaussianScene, camera: Camera) -> F64:
    """(n,) what a view adds to the power sums of Gaussians with nothing before them, but for their opacity."""
    pose = camera.world_to_camera
    x, y, depth = (scene.positions @ pose[:3, :3].T + pose[:3, 3]).T
    before = depth > camera.near
    focal = camera.fx / np.where(before, depth, 1.0)
    sides = np.exp(np.clip(np.sort(scene.log_scales, axis=1)[:, 1:].astype(np.float64), -40, 40)) * focal[:, None]
    reach = _REACH * np.sqrt(sides[:, 1] ** 2 + camera.dilation)
    inside = _inside(camera.cx + x * focal, reach, camera.width)
    inside *= _inside(camera.cy + y * focal * (camera.fy / camera.fx), reach, camera.height)
    area = np.pi * (sides.prod(axis=1) + camera.dilation)
    area = np.minimum(area, camera.width * camera.height) * inside
    # Of a splat that is smaller than a pixel, what counts is how often it meets one.
    return np.asarray(np.where(before, area**SURVEY_POWER + area / 2, 0.0))


def _inside(middle: F64, reach: F64, size: int) -> F64:
    """(n,) part of the intervals of so many pixels about their middles that lies within a picture."""
    width = np.minimum(middle + reach, size) - np.maximum(middle - reach, 0)
    return np.asarray(np.clip(width / (2 * reach), 0, 1))


def measure(overview: Overview, part: Range, scene: GaussianScene) -> Weights:
    """Weigh the Gaussians of a range, in their order, from some of the scene's views: mostly those that tell most."""
    looked, effort = overview.survey, overview.options.effort
    if not looked.cameras:
        return _in_binary32(weigh_draft(scene, looked))
    drawable, sums = overview.make_drawable(part, scene), WeightSums(len(scene))
    few = sample_rows(scene)
    for kind, cameras in looked.views.items():
        most = RANGE_ORBITS if kind == "orbit" else RANGE_VIEWS
        numbers, times = sample_views(estimate_shares(few, cameras), most[effort])
        chosen = [cameras[number] for number in numbers]
        for camera, seen, stands_for in zip(chosen, contributions_by_view(drawable, chosen), times, strict=True):
            sums.add(_own(seen, len(scene)), scene.positions, camera, stands_for)
        sums.end_kind(looked.shares[kind], len(cameras))
    floor = weigh_unoccluded(scene, FLOOR_DISTANCE * looked.radius, overview.bounds.count)
    return _in_binary32(sums.weights(looked.radius, floor))


def _in_binary32(weights: Weights) -> Weights:
    return Weights(*(values.astype(np.float32) for values in vars(weights).values()))


def find_meeting_views(cameras: Sequence[Camera], scene: GaussianScene) -> I64:
    """Find the views that may show any of a scene, by a part of it."""
    few = Drawable.of(sample_rows(scene))
    seen = (number for number, camera in enumerate(cameras) if len(few.near_picture(camera)))
    return np.fromiter(seen, np.int64)


def sample_rows(scene: GaussianScene) -> GaussianScene:
    """Gaussians of a range that tell where it is seen from."""
    return scene.take(sample_evenly(len(scene), MEETING_ROWS / len(scene), 0))


def _own(seen: Contributions, count: int) -> Contributions:
    """Contributions of the first `count` Gaussians."""
    own = int(np.searchsorted(seen.index, count))
    return replace(seen, **{name: values[:own] for name, values in vars(seen).items()})


def sample_range(overview: Overview, part: Range, scene: GaussianScene, measured: Weights) -> Sample:
    """Gaussians of a range: of every range the same share, and of each level of importance, evenly spread in space.

    The few that weigh most open classes of their own, so that each range sends one of its highest level.
    """
    order = np.lexsort((overview.bounds.paths(scene.positions), -importance_levels(measured, scene.sh_degree)))
    step = max(overview.bounds.count / SAMPLE_ROWS, 1.0)
    chosen = order[np.arange(0, len(order), step).astype(np.int64)]
    return scene.take(chosen), measured.take(chosen)


def importance_levels(measured: Weights, sh_degree: int) -> I64:
    """(n,) about the classes of importance that Gaussians will be in, the highest the most important."""
    share = CLASS_COLOUR_SHARE if sh_degree else 0.0
    shape, colour = (np.log(np.maximum(each.astype(np.float64), 1e-30)) for each in (measured.shape, measured.colour))
    found: I64 = np.floor(((1 - share) * shape + share * colour) / np.log(IMPORTANCE_RATIO)).astype(np.int64)
    return found


def concatenate_samples(samples: Sequence[Sample]) -> Sample:
    """The samples of several ranges as one."""
    parts = [vars(measured).values() for _, measured in samples]
    measured = Weights(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
    return concatenate([scene for scene, _ in samples]), measured
