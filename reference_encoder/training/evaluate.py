"""How good the layers of a scene in training are on photos that it does not learn from."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import fmean

import torch
from torch import Tensor

from reference_encoder.training.neural_gaussians import expand
from reference_encoder.training.photo_store import View
from reference_encoder.training.raster import rasterise
from reference_encoder.training.similarity import psnr, ssim
from reference_encoder.training.state import WEIGHT_BITS, State
from scarfmt.render.camera import Camera


@torch.no_grad()
def draw(state: State, camera: Camera, layer: int | None, background: Tensor) -> Tensor:
    """(H, W, 3) picture of a layer, 0-based, as the file has it; None for values as they are."""
    rows = state.in_view(camera, state.plan.count - 1 if layer is None else layer)
    values = state.exact(rows) if layer is None else state.of_layer(rows, layer, None)
    bits = None if layer is None else WEIGHT_BITS
    gaussians, _, _ = expand(values, state.networks, torch.from_numpy(camera.centre), bits)
    return rasterise(gaussians, camera, background).image


def quality(state: State, views: Sequence[View], layer: int | None, background: Tensor) -> tuple[float, float]:
    """Mean PSNR (dB) and SSIM over some views, NaN without any; `layer` as for :func:`draw`."""
    if not views:
        return math.nan, math.nan
    pairs = ((draw(state, view.camera, layer, background), view.photo(state.device)) for view in views)
    found = [(psnr(*pair), ssim(*pair)) for pair in pairs]
    return fmean(each for each, _ in found), fmean(each for _, each in found)
