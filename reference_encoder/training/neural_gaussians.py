"""From anchors to the Gaussians that a camera sees of a layer, differentiable (SPEC §9.6; paper §3.1)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from reference_encoder.training.anchors import SLOTS, SceneNetworks, network_inputs
from reference_encoder.training.fixed_order import one_thread, sigmoid
from reference_encoder.training.raster import Gaussians
from scarfmt.render.camera import Camera
from scarfmt.render.native.binding import FRUSTUM_MARGIN, MIN_ALPHA

_DEVIATIONS = 3.0


@dataclass(frozen=True)
class AnchorValues:
    """Values of n anchors as a layer has them, quantised or with noise in place of it.

    Attributes:
        positions: (n, 3) world units.
        features: (n, D).
        scaling: (n, 6) natural logs.
        offsets: (n, K, 3).
        shown: (n, K) bool, slots that are on.
    """

    positions: Tensor
    features: Tensor
    scaling: Tensor
    offsets: Tensor
    shown: Tensor


@torch.no_grad()
@one_thread()
def in_view(positions: Tensor, scaling: Tensor, offsets: Tensor, camera: Camera) -> Tensor:
    """(V,) int64 rising: anchors a slot of which may be seen by a camera, by a sphere round all of its slots."""
    pose = torch.from_numpy(camera.world_to_camera).to(positions)
    x, y, z = (positions @ pose[:3, :3].T + pose[:3, 3]).unbind(1)
    sizes = torch.exp(scaling)
    far = sizes[:, :3].amax(dim=1) * offsets.abs().amax(dim=(1, 2))
    radius = far + _DEVIATIONS * sizes[:, 3:].amax(dim=1)
    slope_x = FRUSTUM_MARGIN * max(camera.cx, camera.width - camera.cx) / camera.fx
    slope_y = FRUSTUM_MARGIN * max(camera.cy, camera.height - camera.cy) / camera.fy
    seen = (z + radius > camera.near) & (x.abs() < slope_x * z + 2 * radius) & (y.abs() < slope_y * z + 2 * radius)
    return seen.nonzero()[:, 0]


def expand(
    values: AnchorValues, networks: SceneNetworks, eye: Tensor, bits: int | None = None
) -> tuple[Gaussians, Tensor, Tensor]:
    """The Gaussians of slots that are on and opaque enough to show, by anchor, then slot.

    Args:
        eye: (3,) from where networks look at anchors, world units.
        bits: of the networks' weights as the file has them; None for weights as they are.

    Returns:
        M Gaussians; (M,) int64 which of the n anchors each is of, and (M,) int64 which of its slots.
    """
    inputs = network_inputs(values.features, values.positions, eye.to(values.positions))
    opacity = torch.tanh(networks.run("opacity", inputs, bits))
    shown = (opacity >= MIN_ALPHA) & values.shown
    rows, slots = shown.nonzero(as_tuple=True)
    flat = rows * SLOTS + slots
    # Not by [rows]: several slots of an anchor add to one gradient, and index_select is the faster way to add them up.
    covariance = networks.run("cov", inputs, bits).reshape(-1, 7).index_select(0, flat)
    colour = sigmoid(networks.run("color", inputs, bits).reshape(-1, 3).index_select(0, flat))
    sizes = torch.exp(values.scaling).index_select(0, rows)
    offsets = values.offsets.reshape(-1, 3).index_select(0, flat)
    centres = values.positions.index_select(0, rows) + offsets * sizes[:, :3]
    gaussians = Gaussians(
        centres=centres,
        scales=sizes[:, 3:] * sigmoid(covariance[:, :3]),
        rotations=covariance[:, 3:],
        opacities=opacity.reshape(-1).index_select(0, flat),
        colours=colour,
    )
    return gaussians, rows, slots
