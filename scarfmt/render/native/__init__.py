"""The renderer in C (``raster.h``): from Gaussians to splats, tiles, pictures and back, in float32.

One rounding an operation, in a fixed order: the same bits on every machine, whatever the number of threads.

    binding  the compiled library, found and loaded, and its functions and structs
"""
