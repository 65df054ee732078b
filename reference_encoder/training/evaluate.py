"""How good the layers of a scene in training are on photos that it does not learn from."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from reference_encoder.training.expand import expanded, in_view
from reference_encoder.training.raster import rasterise
from reference_encoder.training.similarity import Target, psnr, ssim
from reference_encoder.training.state import WEIGHT_BITS, State
from scarfmt.render.camera import Camera

Views = Sequence[tuple[Camera, Target]]


@torch.no_grad()
def drawn(state: State, camera: Camera, layer: int | None, background: Tensor) -> Tensor:
    """(H, W, 3) picture of a layer, 0-based, as the file has it; None for values as they are."""
    a = state.anchors
    rows = in_view(state.frame.world(a.lattice), a.scaling, a.offsets, camera)
    values = state.exact(rows) if layer is None else state.of_layer(rows, layer, None)
    made = expanded(values, state.networks, torch.from_numpy(camera.centre), None if layer is None else WEIGHT_BITS)
    return rasterise(made.gaussians, camera, background).image


def quality(state: State, views: Views, layer: int | None, background: Tensor) -> tuple[float, float]:
    """Mean PSNR (dB) and SSIM over some views, NaN without any; `layer` as for :func:`drawn`."""
    pictures = [(drawn(state, camera, layer, background), target) for camera, target in views]
    if not pictures:
        return float("nan"), float("nan")
    each = [(psnr(picture, target), ssim(picture, target)) for picture, target in pictures]
    return sum(one[0] for one in each) / len(each), sum(one[1] for one in each) / len(each)
