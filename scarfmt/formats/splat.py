"""antimatter15's `.splat`: 32 bytes for each Gaussian and nothing else, so no magic, and any length fits.

Row: position 3 x float32, standard deviation 3 x float32 (not a logarithm), colour and opacity 4 x uint8, then
the quaternion w, x, y, z as uint8 with 128 for zero. All little-endian. No spherical harmonics.
"""

from __future__ import annotations

from typing import BinaryIO

import numpy as np

from scarfmt.formats.output import Described, Losses, Parts, Says, Written, check_float32, finite, gaussian_sizes
from scarfmt.formats.quantise import SH_C0, alpha_of_logit, dc_of_colour, logit_of_alpha, unit_quaternions
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
    source.check_count(len(data) // _ROW.itemsize, sh_degree=0)
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


def write_splat(parts: Parts, described: Described, target: BinaryIO) -> Written:
    """Write a `.splat` file, in the axes of the scene; Gaussians keep their order.

    Raises:
        InvalidInput: ``output-range``: a value is not finite, or too large for float32; ``output-empty``.
    """
    losses, count = Losses(), 0
    for scene in finite(parts, ".splat"):
        rows = np.zeros(len(scene), _ROW)
        with np.errstate(over="ignore", under="ignore"):  # what overflows is refused below
            rows["position"] = scene.positions
            rows["scale"] = np.exp(scene.log_scales.astype(np.float64))
        check_float32(rows["position"], rows["scale"], ".splat")
        colours = scene.sh[:, 0].astype(np.float64) * SH_C0 + 0.5
        losses.count("colours outside 0 to 1, set to the nearest", (colours < -0.5 / 255) | (colours > 255.5 / 255))
        losses.count("spherical harmonics, left out", scene.sh[:, 1:] != 0)
        losses.count("scales too small for float32, written as 0", rows["scale"] == 0)
        rows["colour"][:, :3] = np.rint(np.clip(colours, 0.0, 1.0) * 255)
        rows["colour"][:, 3] = alpha_of_logit(scene.opacity_logits)
        rows["rotation"] = np.clip(np.rint(unit_quaternions(scene.rotations) * 128 + 128), 0, 255)
        steps = np.spacing(np.abs(rows["position"]).max(axis=1)).astype(np.float64)
        losses.compare_steps(steps, gaussian_sizes(scene.log_scales))
        target.write(rows.tobytes())
        count += len(scene)
    grid = ".splat rounds rotations to 1/128, colours and opacities to 1/255"
    return Written(count, (grid, *losses.notes(described, count, ".splat", Says.NOTHING)))
