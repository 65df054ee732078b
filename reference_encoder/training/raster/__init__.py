"""Differentiable rasteriser for training (docs/train.md, docs/decisions/0034).

picture         what a trainer calls: Gaussians and a camera in, a picture with gradients out
compiled        on the CPU: projection, order, tiles and blending by the compiled library
cuda            on CUDA: the same by torch and Triton
triton_kernels  blending and its gradient
"""

from reference_encoder.training.raster.compiled import Gaussians
from reference_encoder.training.raster.picture import Picture, rasterise

__all__ = ["Gaussians", "Picture", "rasterise"]
