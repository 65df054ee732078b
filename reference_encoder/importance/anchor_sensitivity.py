"""How much errors in an anchor model's parameters show in pictures (encoder only, informative).

As for explicit Gaussians, but a Gaussian's opacity, shape and colour come from the feature through the networks: the
metric that says which feature errors matter is the networks' Jacobian, weighted by how visible each output is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from reference_decoder.anchors import gaussians, log_sigmoid, outlook, sigmoid, unit_vectors
from reference_encoder.importance.view_sampling import Views
from reference_encoder.importance.weights import pixel_angle
from reference_encoder.tuning import ASPECT_CAP, BLUR_PX2, METRIC_ANCHORS
from scarfmt.arrays import F32, F64
from scarfmt.render.camera import Camera
from scarfmt.render.rasterise import contributions_by_view, render
from scarfmt.scene.gaussians import AnchorModel, Mlp

_FAINT = 0.02
"""Below this opacity, an error in it does not show."""


@dataclass(frozen=True)
class AnchorSensitivity:
    """Mean squared picture error per squared unit.

    Attributes:
        shape: (N, K) of each slot's relative shape and opacity.
        colour: (N, K) of each slot's colour.
        inverse_variance: (N, K) one over the slot's middle-axis variance, blur included.
        metric: (D, D) which feature errors matter, for an anchor of total weight 1.
    """

    shape: F64
    colour: F64
    inverse_variance: F64
    metric: F64

    def take(self, index: NDArray[np.integer]) -> AnchorSensitivity:
        """The anchors at `index`, in that order."""
        return AnchorSensitivity(self.shape[index], self.colour[index], self.inverse_variance[index], self.metric)


def draw_anchors(model: AnchorModel) -> Callable[[Camera], F32]:
    """From camera to (height, width, 3) float32 picture of a model."""

    def picture(camera: Camera) -> F32:
        seen = gaussians(model, camera.centre)
        return render(seen.scene, camera, colours=seen.colours.astype(np.float64))

    return picture


def measure_anchors(model: AnchorModel, survey: Views, seed: int, report: Callable[[float], None]) -> AnchorSensitivity:
    """Sensitivities of all N anchors in a survey's views: means over each kind, and of these by their shares."""
    shape, colour, inverse, hits = (np.zeros((len(model), model.slots)) for _ in range(4))
    shares = [survey.shares[kind] / len(cameras) for kind, cameras in survey.views.items() for _ in cameras]
    for number, (camera, share) in enumerate(zip(survey.cameras, shares, strict=True), start=1):
        seen = gaussians(model, camera.centre)
        at, samples = (seen.anchors, seen.slots), camera.width * camera.height * 3
        [shown] = contributions_by_view(seen.scene, [camera], seen.colours.astype(np.float32))
        visible = seen.anchors[shown.index], seen.slots[shown.index]
        shape[visible] += share * shown.contrast_sq / samples
        colour[visible] += share * shown.weight_sq / samples
        distance = np.linalg.norm(seen.scene.positions - camera.centre, axis=1)
        middle = np.exp(2 * np.sort(seen.scene.log_scales, axis=1)[:, 1])
        inverse[at] += 1 / (middle + BLUR_PX2 * (distance * pixel_angle(camera)) ** 2)
        hits[at] += 1
        report(number / len(shares))
    metric = feature_metric(model, survey.cameras, shape, colour, seed)
    return AnchorSensitivity(shape, colour, inverse / np.maximum(hits, 1), metric)


def feature_metric(model: AnchorModel, cameras: Sequence[Camera], shape: F64, colour: F64, seed: int) -> F64:
    """(D, D) average of J^T S J over anchors drawn by their visibility, J the Jacobian of what is drawn.

    Args:
        shape, colour: (N, K) as :class:`AnchorSensitivity` has them.
    """
    weight, width = (shape + colour).sum(axis=1), model.features.shape[1]
    if not weight.any():
        return np.eye(width)
    draw = np.random.default_rng(seed)
    chosen = draw.choice(len(model), size=min(METRIC_ANCHORS, len(model)), p=weight / weight.sum())
    centres = np.stack([cameras[i].centre for i in draw.integers(0, len(cameras), len(chosen))])
    jacobian = _jacobian(model, np.asarray(outlook(model, chosen, centres, np.float64), np.float64), width)
    per_output = np.concatenate(
        [
            np.repeat(shape[chosen][:, :, None], 4, axis=2),
            np.repeat(shape[chosen][:, :, None] * ASPECT_CAP / 4, 4, axis=2),
            np.repeat(colour[chosen][:, :, None], 3, axis=2),
        ],
        axis=2,
    )
    flat = (jacobian * np.sqrt(per_output / weight[chosen][:, None, None])[..., None]).reshape(-1, width)
    return np.asarray(flat.T @ flat / len(chosen))


def _jacobian(model: AnchorModel, inputs: F64, width: int) -> F64:
    """(n, K, 11, D) derivatives by the feature of what is drawn of n anchors.

    Of each slot: logarithms of its opacity and three scales, twice its unit quaternion, and its colour.
    """
    n, slots = len(inputs), model.slots
    raw, by_raw = _outputs(model.mlps["opacity"], inputs, width)
    opacity = np.tanh(raw)
    by_opacity = np.where(opacity > _FAINT, (1 - opacity**2) / np.maximum(opacity, _FAINT), 0)
    shape, by_shape = (part.reshape(n, slots, 7, -1) for part in _outputs(model.mlps["cov"], inputs, width))
    unit, length, exponent = unit_vectors(shape[:, :, 3:, 0].reshape(-1, 4))
    longest = 2 / np.maximum(np.ldexp(length, exponent), 1e-12)
    turns = (np.eye(4) - unit[:, :, None] * unit[:, None]) * longest[:, None]
    tint, by_tint = (part.reshape(n, slots, 3, -1) for part in _outputs(model.mlps["color"], inputs, width))
    shade = sigmoid(tint)
    return np.concatenate(
        [
            (by_opacity[..., None] * by_raw)[:, :, None],
            np.exp(log_sigmoid(-shape[:, :, :3])) * by_shape[:, :, :3],
            turns.reshape(n, slots, 4, 4) @ by_shape[:, :, 3:],
            shade * (1 - shade) * by_tint,
        ],
        axis=2,
    )


def _outputs(mlp: Mlp, inputs: F64, width: int) -> tuple[F64, F64]:
    """(n, out) of (n, in), and their (n, out, D) derivatives by the first D = `width` inputs."""
    first, second = (weights.astype(np.float64) for weights in mlp.weights)
    hidden = inputs @ first.T + mlp.biases[0]
    slopes = (second * (hidden > 0)[:, None]) @ first[:, :width]
    return np.maximum(hidden, 0) @ second.T + mlp.biases[1], slopes
