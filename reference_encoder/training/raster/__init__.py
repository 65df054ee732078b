"""Differentiable rasteriser for training (docs/training.md, docs/decisions/0034).

picture      what a trainer calls: Gaussians and a camera in, a picture with gradients out
gaussians    what is drawn
prepare      on the CPU: projection, order and tiles (project.c, bins.c)
composite    on the CPU: blending (composite.c) and its gradient
loading      the compiled library
cuda         on CUDA: the same by torch and Triton
projection   in torch: EWA projection and its gradient; which Gaussians show
binning      in torch: which splats may show in which tile
triton_kernels  blending and its gradient
"""

from reference_encoder.training.raster.gaussians import Gaussians
from reference_encoder.training.raster.picture import Picture, rasterise

__all__ = ["Gaussians", "Picture", "rasterise"]
