"""The weight of each Gaussian in pictures from everywhere (encoder only, informative).

The currency: mean squared error of a picture (peak 1, over pixels and colours) per squared unit of relative error, as a
power mean over views: (mean over views of s^p)^(1/p). It leans to the views that show a Gaussian most. When bits are
given so that every Gaussian's weight times its squared error is the same, a view's error is the sum of s_in_view / s:
of a plain mean, what a share f of the views shows counts 1/f times in those, and they look bad; here f^(-1/p) times
(docs/decisions/0023-survey-of-everywhere.md).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from reference_encoder.importance.view_sampling import Views
from reference_encoder.tuning import (
    DRAFT_GAUSSIANS,
    FLOOR_CONTRAST,
    FLOOR_DISTANCE,
    FLOOR_GAUSSIANS,
    FLOOR_SHARE,
    SURVEY_POWER,
)
from scarfmt.arrays import F32, F64, I64, Floats
from scarfmt.render.camera import DILATION_PX2, Camera
from scarfmt.render.native.binding import MIN_ALPHA
from scarfmt.render.projection import Drawable
from scarfmt.render.rasterise import Contributions, contributions_by_view
from scarfmt.render.viewpoints import FOV_DEG, HEIGHT, WIDTH
from scarfmt.scene.gaussians import GaussianScene

PIXEL = 2 * math.tan(math.radians(FOV_DEG) / 2) / WIDTH
"""Width of a pixel of a survey's picture, a world unit away."""


@dataclass(frozen=True)
class Weights:
    """The weights of N Gaussians, all kinds of views together, and no less than a floor.

    Attributes:
        shape: (N,) per squared relative change of the splat.
        colour: (N,) per squared change of its colour.
        pixel: (N,) float32 width of a pixel at each, world units: geometric mean over the views, by weight.
        largest: (N,) float32 largest blending weight in any pixel, 0..0.99.
    """

    shape: Floats
    colour: Floats
    pixel: F32
    largest: F32

    def take(self, rows: I64) -> Weights:
        """Those of the Gaussians at `rows`, in that order."""
        return Weights(*(values[rows] for values in vars(self).values()))


class WeightSums:
    """Power sums over views of so many Gaussians.

    Attributes:
        shape, colour: (N,) float64 sums, over views of one kind, of weights to the power.
        log_pixel, weight: (N,) float64 sums over all kinds: logarithms of the width of a pixel by weight, and weights.
        largest: (N,) float32.
    """

    def __init__(self, count: int) -> None:
        self.log_pixel, self.weight, self.largest = np.zeros(count), np.zeros(count), np.zeros(count, np.float32)
        self.shape, self.colour = np.zeros(count), np.zeros(count)
        self._shapes, self._colours = np.zeros(count), np.zeros(count)

    def add(self, seen: Contributions, positions: F64, camera: Camera, times: float = 1.0) -> None:
        """Add a view, the sums of its picture divided by the number of its samples, as so many views."""
        samples, index = camera.width * camera.height * 3, seen.index
        shape = times * (seen.contrast_sq / samples) ** SURVEY_POWER
        away = positions[index]
        away -= camera.centre
        distance_sq = np.einsum("ij,ij->i", away, away)
        self.shape[index] += shape
        self.colour[index] += times * (seen.weight_sq / samples) ** SURVEY_POWER
        self.log_pixel[index] += shape * (0.5 * np.log(np.maximum(distance_sq, 1e-24)) + np.log(pixel_angle(camera)))
        self.weight[index] += shape
        self.largest[index] = np.maximum(self.largest[index], seen.weight_max.astype(np.float32))

    def end_kind(self, share: float, views: float) -> None:
        """Go on to another kind: the power means over as many views of this one count so much."""
        for whole, own in ((self._shapes, self.shape), (self._colours, self.colour)):
            mean = ((own / max(views, 1)) ** (1 / SURVEY_POWER)).astype(np.float32)
            whole += share * mean.astype(np.float64) ** SURVEY_POWER
            own[:] = 0

    def weights(self, radius: float, floor: tuple[F32, F32]) -> Weights:
        """The weights of all kinds that ended.

        Args:
            radius: of the scene: Gaussians that are not seen have the pixel that is usual there.
            floor: (N,) least weights of shape and of colour.
        """
        usual = np.full(len(self.weight), np.log(FLOOR_DISTANCE * radius * PIXEL))
        logs = np.divide(self.log_pixel, self.weight, where=self.weight > 0, out=usual)
        totals = zip((self._shapes, self._colours), floor, strict=True)
        shape, colour = (np.maximum(total ** (1 / SURVEY_POWER), least) for total, least in totals)
        return Weights(shape, colour, np.exp(logs).astype(np.float32), self.largest)


def pixel_angle(camera: Camera) -> float:
    """Width of a pixel of the whole picture a world unit away, of a view of which some pixels are sampled."""
    return float(np.sqrt(camera.dilation / DILATION_PX2) / camera.fx)


def weigh_scene(scene: GaussianScene, survey: Views, report: Callable[[float], None] = lambda _: None) -> Weights:
    """The weights of the Gaussians of a scene in the views of a survey.

    Args:
        report: receives the part of the views that are done.
    """
    drawable, sums, done = Drawable.of(scene), WeightSums(len(scene)), 0
    for kind, cameras in survey.views.items():
        for camera, seen in zip(cameras, contributions_by_view(drawable, cameras), strict=True):
            sums.add(seen, scene.positions, camera)
            done += 1
            report(done / len(survey.cameras))
        sums.end_kind(survey.shares[kind], len(cameras))
    return sums.weights(survey.radius, weigh_unoccluded(scene, FLOOR_DISTANCE * survey.radius, len(scene)))


def weigh_draft(scene: GaussianScene, survey: Views) -> Weights:
    """The weights of Gaussians that nobody has looked at, by size and opacity: as if nothing were in front of any.

    Args:
        scene: all of it, or a part.
        survey: without views; of the whole scene.
    """
    near = FLOOR_DISTANCE * survey.radius
    shape, colour = (each.astype(np.float64) for each in weigh_unoccluded(scene, near, DRAFT_GAUSSIANS))
    return Weights(shape, colour, np.full(len(scene), near * PIXEL, np.float32), np.ones(len(scene), np.float32))


def weigh_unoccluded(scene: GaussianScene, distance: float, count: int) -> tuple[F32, F32]:
    """(N,) weights of shape and of colour: a share of what each would weigh with nothing in front of it.

    A splat of opacity o whose ellipse has the area pi s t covers o^2 pi s t of squared weights; seen from all sides,
    its two longest axes show about two thirds of that. It contrasts by `FLOOR_CONTRAST` with what is behind.

    Args:
        distance: so far away, world units.
        count: Gaussians of the whole scene.
    """
    width = distance * PIXEL
    blur = DILATION_PX2 * width**2
    scales = np.sort(scene.log_scales, axis=1)[:, 1:].astype(np.float64)
    area = np.sqrt(np.prod(np.exp(2 * scales) + blur, axis=1)) / width**2
    opacity = 1 / (1 + np.exp(-scene.opacity_logits.astype(np.float64)))
    covered = np.minimum(np.pi * 2 / 3 * area, WIDTH * HEIGHT) * opacity**2 * (opacity >= MIN_ALPHA)
    share = FLOOR_SHARE * min(1.0, count / FLOOR_GAUSSIANS)
    weight = share * covered / (3 * WIDTH * HEIGHT)
    return (FLOOR_CONTRAST**2 * weight).astype(np.float32), weight.astype(np.float32)
