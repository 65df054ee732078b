"""Training: anchors, entropy model and quantisation together, from photos.

raster  differentiable rasteriser: the picture of Gaussians, and its gradient
"""
