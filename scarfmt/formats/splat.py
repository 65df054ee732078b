"""antimatter15's `.splat`: 32 bytes for each Gaussian and nothing else, so no magic, and any length fits.

Row: position 3 x float32, standard deviation 3 x float32 (not a logarithm), colour and opacity 4 x uint8, then
the quaternion w, x, y, z as uint8 with 128 for zero. All little-endian. No spherical harmonics.
"""

from __future__ import annotations

import numpy as np

from scarfmt.formats.dequantise import dc_of_colour, logit_of_alpha
from scarfmt.formats.source import Source
from scarfmt.scene.gaussians import GaussianScene

_ROW = np.dtype([("position", "<f4", 3), ("scale", "<f4", 3), ("colour", "u1", 4), ("rotation", "u1", 4)])


def sniff(source: Source) -> bool:
    """Never: the content has no mark; the extension, or an explicit format, selects this importer."""
    return False


def load(source: Source) -> GaussianScene:
    """Read a `.splat` file. A standard deviation of zero or less has no logarithm and gives -inf or NaN.

    Raises:
        InvalidInput: the size is not a multiple of 32 bytes.
    """
    data = source.read()
    if len(data) % _ROW.itemsize:
        raise source.corrupt(f"{len(data)} bytes is not a whole number of 32-byte rows")
    source.check_count(len(data) // _ROW.itemsize)
    rows = np.frombuffer(data, _ROW)
    with np.errstate(divide="ignore", invalid="ignore"):
        log_scales = np.log(rows["scale"])
    return GaussianScene(
        rows["position"].astype(np.float64),
        log_scales,
        ((rows["rotation"] - 128.0) / 128.0).astype(np.float32),
        logit_of_alpha(rows["colour"][:, 3]),
        dc_of_colour(rows["colour"][:, :3] / 255.0),
    )
