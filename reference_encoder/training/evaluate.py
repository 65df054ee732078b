"""How good the layers of a scene in training are on photos that it does not learn from."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from reference_encoder.training.expand import expanded, in_view
from reference_encoder.training.iterate import Mode, layer_values
from reference_encoder.training.raster import rasterise
from reference_encoder.training.similarity import Target, psnr, ssim
from reference_encoder.training.state import WEIGHT_BITS, State
from scarfmt.render.camera import Camera

Views = Sequence[tuple[Camera, Target]]


@torch.no_grad()
def drawn(state: State, camera: Camera, mode: Mode, background: Tensor) -> Tensor:
    """(H, W, 3) picture of a layer."""
    a = state.anchors
    rows = in_view(state.frame.world(a.lattice), a.scaling, a.offsets, camera)
    made = expanded(layer_values(state, rows, mode), state.networks, camera, WEIGHT_BITS if mode.hard else None)
    return rasterise(made.gaussians, camera, background).image


def quality(state: State, views: Views, layer: int, hard: bool, background: Tensor) -> tuple[float, float]:
    """Mean PSNR (dB) and SSIM of a layer, 0-based, over some views; NaN without any.

    Args:
        hard: values rounded as the file has them, else as they are.
    """
    mode = Mode(layer=layer, noise=False, hard=hard, counts=False, price=0.0)
    pictures = [(drawn(state, camera, mode, background), target) for camera, target in views]
    if not pictures:
        return float("nan"), float("nan")
    each = [(psnr(picture, target), ssim(picture, target)) for picture, target in pictures]
    return sum(one[0] for one in each) / len(each), sum(one[1] for one in each) / len(each)
