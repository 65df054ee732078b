"""How much errors in an anchor model's parameters show in pictures (encoder only, informative).

As for explicit Gaussians, but a Gaussian's opacity, shape and colour come from the feature through the
MLPs: the metric that says which feature errors matter is the networks' Jacobian, weighted by how visible
each output is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from reference_encoder.measure.survey import Survey
from reference_encoder.measure.weights import pixel_angle
from reference_encoder.tuning import ASPECT_CAP, BLUR_PX2, METRIC_ANCHORS
from scarfmt.arrays import F32, F64
from scarfmt.render.camera import Camera
from scarfmt.render.rasterise import contributions, render
from scarfmt.scene.gaussians import AnchorModel, GaussianScene


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

    @property
    def feature(self) -> F64:
        """(N,) weight of each anchor's feature."""
        return np.asarray((self.shape + self.colour).sum(axis=1))


def _tensors(model: AnchorModel) -> dict[str, list[torch.Tensor]]:
    return {
        name: [
            torch.from_numpy(np.asarray(part, np.float32))
            for pair in zip(mlp.weights, mlp.biases, strict=True)
            for part in pair
        ]
        for name, mlp in model.mlps.items()
    }


def _apply(parts: list[torch.Tensor], x: torch.Tensor) -> torch.Tensor:
    first, bias, second, last = parts
    return torch.relu(x @ first.T + bias) @ second.T + last


def _inputs(features: torch.Tensor, offset: torch.Tensor, width: int) -> torch.Tensor:
    distance = offset.norm(dim=-1, keepdim=True)
    u = torch.cat([features, offset / distance, distance], dim=-1)
    return u[..., :width]


def _slots(model: AnchorModel, networks: dict[str, list[torch.Tensor]], centre: F64) -> dict[str, NDArray[np.float32]]:
    """Opacity (N, K), log scale (N, K, 3), quaternion (N, K, 4), colour (N, K, 3) seen from `centre`."""
    n, k = len(model), model.slots
    offset = torch.from_numpy((model.anchors - centre).astype(np.float32))
    u = _inputs(torch.from_numpy(model.features), offset, networks["opacity"][0].shape[1])
    with torch.no_grad():
        cov = _apply(networks["cov"], u).reshape(n, k, 7)
        log_scale = torch.from_numpy(model.log_scaling)[:, None, 3:] + torch.nn.functional.logsigmoid(cov[..., :3])
        return {
            "opacity": torch.tanh(_apply(networks["opacity"], u)).numpy(),
            "log_scale": log_scale.numpy(),
            "rotation": cov[..., 3:].numpy(),
            "colour": torch.sigmoid(_apply(networks["color"], u)).reshape(n, k, 3).numpy(),
        }


@dataclass(frozen=True)
class _Seen:
    """M slots as one camera sees them.

    Attributes:
        scene: their Gaussians, without colour.
        colours: (M, 3) float32.
        anchor, slot: (M,) which they are.
    """

    scene: GaussianScene
    colours: NDArray[np.float32]
    anchor: NDArray[np.intp]
    slot: NDArray[np.intp]


def _seen(model: AnchorModel, networks: dict[str, list[torch.Tensor]], centres: F64, camera: Camera) -> _Seen:
    """The slots that a camera may see; `centres` (N, K, 3) are theirs."""
    made = _slots(model, networks, camera.centre)
    shown = made["opacity"] > 0
    anchor, slot = np.nonzero(shown if model.slot_mask is None else shown & model.slot_mask)
    opacity = made["opacity"][anchor, slot].astype(np.float64)
    scene = GaussianScene(
        centres[anchor, slot],
        made["log_scale"][anchor, slot],
        made["rotation"][anchor, slot],
        np.log(opacity / np.maximum(1 - opacity, 1e-6)).astype(np.float32),
        np.zeros((len(anchor), 1, 3), np.float32),
    )
    return _Seen(scene, made["colour"][anchor, slot], anchor, slot)


def _centres(model: AnchorModel) -> F64:
    return np.asarray(model.anchors[:, None] + model.offsets * np.exp(model.log_scaling[:, None, :3]))


def anchor_view(model: AnchorModel) -> Callable[[Camera], F32]:
    """From camera to (height, width, 3) float32 picture of a model."""
    networks, centres = _tensors(model), _centres(model)

    def picture(camera: Camera) -> F32:
        seen = _seen(model, networks, centres, camera)
        return render(seen.scene, camera, colours=seen.colours.astype(np.float64))

    return picture


def measure_anchors(
    model: AnchorModel, survey: Survey, seed: int, report: Callable[[float], None]
) -> AnchorSensitivity:
    """Sensitivities of all N anchors in a survey's views: means over each kind, and of these by their shares."""
    shape, colour, inverse, hits = (np.zeros((len(model), model.slots)) for _ in range(4))
    shares = [survey.shares[kind] / len(cameras) for kind, cameras in survey.views.items() for _ in cameras]
    for number, seen in enumerate(seen_slots(model, survey.cameras)):
        shape[seen.anchor, seen.slot] += shares[number] * seen.shape
        colour[seen.anchor, seen.slot] += shares[number] * seen.colour
        inverse[seen.anchor, seen.slot] += seen.inverse_variance
        hits[seen.anchor, seen.slot] += 1
        report((number + 1) / len(shares))
    metric = feature_metric(model, survey.cameras, shape, colour, seed)
    return AnchorSensitivity(shape, colour, inverse / np.maximum(hits, 1), metric)


@dataclass(frozen=True)
class SlotWeights:
    """The weights of the M slots that one camera may see.

    Attributes:
        anchor, slot: (M,) which they are.
        shape, colour: (M,) mean squared error of the picture per squared unit, as :class:`AnchorSensitivity` has them.
        inverse_variance: (M,) as there.
    """

    anchor: NDArray[np.intp]
    slot: NDArray[np.intp]
    shape: F64
    colour: F64
    inverse_variance: F64


def seen_slots(model: AnchorModel, cameras: Sequence[Camera]) -> Iterator[SlotWeights]:
    """Weights of slots, for one camera after another."""
    networks, centres = _tensors(model), _centres(model)
    for camera in cameras:
        made = _seen(model, networks, centres, camera)
        scene = made.scene
        seen = contributions(scene, [camera], colours=made.colours)
        samples = camera.width * camera.height * 3
        distance = np.linalg.norm(scene.positions - camera.centre, axis=1)
        middle = np.exp(2 * np.sort(scene.log_scales, axis=1)[:, 1])
        inverse = 1 / (middle + BLUR_PX2 * (distance * pixel_angle(camera)) ** 2)
        yield SlotWeights(made.anchor, made.slot, seen.contrast_sq / samples, seen.weight_sq / samples, inverse)


def feature_metric(model: AnchorModel, cameras: Sequence[Camera], shape: F64, colour: F64, seed: int) -> F64:
    """(D, D) average of J^T S J over anchors drawn by their visibility, J the Jacobian of what is drawn.

    Args:
        cameras: eyes of the Jacobians.
        shape, colour: (N, K) as :class:`AnchorSensitivity` has them.
        seed: of the draw.
    """
    networks = _tensors(model)
    weight = (shape + colour).sum(axis=1)
    if not weight.any():
        return np.eye(model.features.shape[1])
    draw = np.random.default_rng(seed)
    chosen = draw.choice(len(model), size=min(METRIC_ANCHORS, len(model)), p=weight / weight.sum())
    eyes = np.stack([cameras[i].centre for i in draw.integers(0, len(cameras), len(chosen))])
    offset = torch.from_numpy((model.anchors[chosen] - eyes).astype(np.float32))
    width, slots = networks["opacity"][0].shape[1], model.slots

    def drawn(feature: torch.Tensor, direction: torch.Tensor) -> torch.Tensor:
        u = _inputs(feature, direction, width)
        cov = _apply(networks["cov"], u).reshape(slots, 7)
        opacity = torch.log(torch.tanh(_apply(networks["opacity"], u)).clamp_min(0.02))[:, None]
        rotation = 2 * torch.nn.functional.normalize(cov[:, 3:], dim=1)
        colours = torch.sigmoid(_apply(networks["color"], u)).reshape(slots, 3)
        return torch.cat([opacity, torch.nn.functional.logsigmoid(cov[:, :3]), rotation, colours], dim=1)

    jacobian = torch.func.vmap(torch.func.jacrev(drawn))(torch.from_numpy(model.features[chosen]), offset)
    per_output = np.concatenate(
        [
            np.repeat(shape[chosen][:, :, None], 4, axis=2),
            np.repeat(shape[chosen][:, :, None] * ASPECT_CAP / 4, 4, axis=2),
            np.repeat(colour[chosen][:, :, None], 3, axis=2),
        ],
        axis=2,
    )
    scaled = jacobian.double() * torch.from_numpy(np.sqrt(per_output / weight[chosen][:, None, None]))[..., None]
    flat = scaled.reshape(-1, model.features.shape[1])
    return np.asarray((flat.T @ flat / len(chosen)).numpy())
