"""The content of a file as plain values: no bytes, no networks (SPEC §6, §9).

gaussians   a scene of 3D Gaussians, or an anchor model, in float arrays: what users give and get
model       channels, classes, layer table: what a file says of its integers (SPEC §6.4, §6.5)
codebooks   the codewords of residual vector quantisation
rotation, activation   the small formulas that encoder, decoder and renderer share
"""
