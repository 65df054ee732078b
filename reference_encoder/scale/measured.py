"""What the Gaussians of one range weigh in pictures of the whole scene (encoder only; docs/decisions/0044)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from reference_encoder.measure.weights import Sums, Weights, unoccluded
from reference_encoder.scale.glance import Overview, drawn_evenly
from reference_encoder.scale.steps import Measured, Range
from reference_encoder.tuning import FLOOR_DISTANCE, MEETING_ROWS, RANGE_VIEWS
from scarfmt.arrays import I64
from scarfmt.render.camera import Camera
from scarfmt.render.projection import Drawable, project
from scarfmt.render.rasterise import ViewContributions, contributions_by_view
from scarfmt.scene.gaussians import GaussianScene


def measure(overview: Overview, part: Range, scene: GaussianScene) -> Measured:
    """What the Gaussians of a range weigh: from some of the scene's views that meet it, by how many there are.

    Args:
        overview: of the whole scene.
        part: the range.
        scene: its Gaussians, in any order; the result is in the same.
    """
    looked, most = overview.survey, RANGE_VIEWS[overview.options.effort]
    drawable, sums, kinds = overview.drawn(part, scene), Sums(len(scene)), {}
    for kind, cameras in looked.views.items():
        sums.start()
        meeting = met(cameras, scene)
        chosen = [cameras[number] for number in spread(meeting, most)]
        for camera, seen in zip(chosen, contributions_by_view(drawable, chosen), strict=True):
            sums.add(_own(seen, len(scene)), scene.positions, camera)
        # Views left out show what those beside them do.
        kinds[kind] = sums.means(len(cameras) * len(chosen) / max(len(meeting), 1))
    floor = unoccluded(scene, FLOOR_DISTANCE * looked.radius, overview.bounds.count)
    weights = Weights(kinds, looked.shares, floor, sums.pixel(looked.radius), sums.largest)
    shape, colour = weights.shape.astype(np.float32), weights.colour.astype(np.float32)
    return Measured(shape, colour, weights.pixel, weights.largest)


def met(cameras: Sequence[Camera], scene: GaussianScene) -> I64:
    """Which of some views that may show any of a scene, told by a part of it."""
    few = Drawable.of(scene.take(drawn_evenly(len(scene), MEETING_ROWS / len(scene), 0)))
    seen = (number for number, camera in enumerate(cameras) if len(project(few, camera, sh_degree=0)[2]))
    return np.fromiter(seen, np.int64)


def spread(numbers: I64, most: int) -> I64:
    """At most so many of some numbers, evenly."""
    count = min(most, len(numbers))
    return numbers[np.arange(count) * len(numbers) // max(count, 1)]


def _own(seen: ViewContributions, count: int) -> ViewContributions:
    """What the first `count` Gaussians contribute."""
    own = int(np.searchsorted(seen.index, count))
    return replace(seen, **{name: values[:own] for name, values in vars(seen).items()})
