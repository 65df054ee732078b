"""Differentiable rasteriser for training: torch projects, bins and sorts, a kernel of its own composites.

picture      what a trainer calls: Gaussians and a camera in, a picture with gradients out
projection   EWA projection and its gradient; which Gaussians show
binning      which splats may show in which tile
composite    blending on the CPU (composite.c) and its gradient
loading      the compiled library
"""

from reference_encoder.training.raster.picture import Picture, rasterise
from reference_encoder.training.raster.projection import Gaussians

__all__ = ["Gaussians", "Picture", "rasterise"]
