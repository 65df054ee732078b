"""A picture of Gaussians that gradients flow through."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from reference_encoder.training.raster.compiled import Gaussians, composite, prepare
from reference_encoder.training.raster.cuda import draw
from scarfmt.render.camera import Camera


@dataclass(frozen=True)
class Picture:
    """The picture that a camera sees of M Gaussians.

    Attributes:
        image: (H, W, 3) float32, linear in the colours and not clipped, with a gradient.
        means: (M, 2) float32 pixel positions of the centres; after a backward pass `means.grad` is the gradient with
            respect to them. Of Gaussians that are not shown, some number.
        shown: (M,) bool, whether a Gaussian may touch the centre of a pixel.
        weights: (M,) float32, sum of alpha times transmittance over the pixels, without gradient.
    """

    image: Tensor
    means: Tensor
    shown: Tensor
    weights: Tensor


def rasterise(gaussians: Gaussians, camera: Camera, background: Tensor) -> Picture:
    """Draw Gaussians by the image model of :mod:`scarfmt.render.rasterise`, in float32.

    On the CPU, or on the CUDA device that the Gaussians are on. Results and gradients are the same bits every time, on
    the CPU whatever the number of threads (`torch.get_num_threads()` are used).

    Args:
        background: (3,) float32 colour behind everything.

    Raises:
        InvalidInput: ``input-dependency`` where the compiled library, or on CUDA Triton, is missing.
    """
    if gaussians.centres.device.type == "cpu":
        prepared = prepare(gaussians, camera)
        means, which = prepared.means, prepared.which
        image, parts = composite(prepared, gaussians, background, camera)
    else:
        image, means, which, parts = draw(gaussians, camera, background)
    shown, weights = means.new_zeros(len(means), dtype=torch.bool), means.new_zeros(len(means))
    picture = Picture(image, means, shown.index_fill_(0, which, True), weights.index_copy_(0, which, parts))
    if picture.means.requires_grad:
        picture.means.retain_grad()
    return picture
