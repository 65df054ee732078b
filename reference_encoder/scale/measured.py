"""Weights of the Gaussians of one range in pictures of the whole scene (encoder only; docs/decisions/0044)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from reference_encoder.measure.weights import Sums, Weights, unoccluded
from reference_encoder.scale.drawn_views import drawn_views, told
from reference_encoder.scale.glance import Overview, drawn_evenly
from reference_encoder.scale.steps import Measured, Range
from reference_encoder.tuning import FLOOR_DISTANCE, MEETING_ROWS, RANGE_ORBITS, RANGE_VIEWS
from scarfmt.arrays import I64
from scarfmt.render.camera import Camera
from scarfmt.render.projection import Drawable, project
from scarfmt.render.rasterise import ViewContributions, contributions_by_view
from scarfmt.scene.gaussians import GaussianScene


def measure(overview: Overview, part: Range, scene: GaussianScene) -> Measured:
    """Weigh the Gaussians of a range from some of the scene's views, above all from those that tell most of it.

    Args:
        overview: of the whole scene.
        part: the range.
        scene: its Gaussians, in any order; the result is in the same.
    """
    looked, effort = overview.survey, overview.options.effort
    drawable, sums, kinds = overview.drawn(part, scene), Sums(len(scene)), {}
    few = some_of(scene)
    for kind, cameras in looked.views.items():
        sums.start()
        most = RANGE_ORBITS if kind == "orbit" else RANGE_VIEWS
        numbers, times = drawn_views(told(few, cameras), most[effort])
        chosen = [cameras[number] for number in numbers]
        for camera, seen, stands_for in zip(chosen, contributions_by_view(drawable, chosen), times, strict=True):
            sums.add(_own(seen, len(scene)), scene.positions, camera, stands_for)
        kinds[kind] = sums.means(len(cameras))
    floor = unoccluded(scene, FLOOR_DISTANCE * looked.radius, overview.bounds.count)
    weights = Weights(kinds, looked.shares, floor, sums.pixel(looked.radius), sums.largest)
    shape, colour = weights.shape.astype(np.float32), weights.colour.astype(np.float32)
    return Measured(shape, colour, weights.pixel, weights.largest)


def met(cameras: Sequence[Camera], scene: GaussianScene) -> I64:
    """Find the views that may show any of a scene, by a part of it."""
    few = Drawable.of(some_of(scene))
    seen = (number for number, camera in enumerate(cameras) if len(project(few, camera, sh_degree=0)[2]))
    return np.fromiter(seen, np.int64)


def some_of(scene: GaussianScene) -> GaussianScene:
    """Gaussians of a range that tell where it is seen from."""
    return scene.take(drawn_evenly(len(scene), MEETING_ROWS / len(scene), 0))


def _own(seen: ViewContributions, count: int) -> ViewContributions:
    """Contributions of the first `count` Gaussians."""
    own = int(np.searchsorted(seen.index, count))
    return replace(seen, **{name: values[:own] for name, values in vars(seen).items()})
