"""Real spherical harmonics of degree 0 to 3 in INRIA's sign and order: their values, and coefficients turned."""

from __future__ import annotations

import numpy as np

from scarfmt.arrays import F32, F64

_GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))
_DIRECTIONS = 32
"""More than the 16 functions there are, spread over the sphere, so that a least squares fit of each band is exact."""


def sh_basis(directions: F64, degree: int) -> F64:
    """(..., (degree + 1)^2) float64 real spherical harmonics of unit (..., 3) directions, INRIA's sign and order."""
    x, y, z = np.moveaxis(directions, -1, 0)
    out = [np.full(x.shape, 0.28209479177387814)]
    if degree >= 1:
        out += [-0.4886025119029199 * y, 0.4886025119029199 * z, -0.4886025119029199 * x]
    if degree >= 2:
        out += [
            1.0925484305920792 * x * y,
            -1.0925484305920792 * y * z,
            0.31539156525252005 * (2 * z * z - x * x - y * y),
            -1.0925484305920792 * x * z,
            0.5462742152960396 * (x * x - y * y),
        ]
    if degree >= 3:
        out += [
            -0.5900435899266435 * y * (3 * x * x - y * y),
            2.890611442640554 * x * y * z,
            -0.4570457994644658 * y * (4 * z * z - x * x - y * y),
            0.3731763325901154 * z * (2 * z * z - 3 * x * x - 3 * y * y),
            -0.4570457994644658 * x * (4 * z * z - x * x - y * y),
            1.445305721320277 * z * (x * x - y * y),
            -0.5900435899266435 * x * (x * x - 3 * y * y),
        ]
    return np.stack(out, axis=-1)


def turned(sh: F32, rotation: F64) -> F32:
    """Coefficients of a scene after it was turned: its colour in direction R d is what it was in direction d.

    Args:
        sh: (N, (degree + 1)^2, 3).
        rotation: (3, 3) rotation matrix R.
    """
    degree = round(sh.shape[1] ** 0.5) - 1
    directions = _spread(_DIRECTIONS)
    after, before = sh_basis(directions, degree), sh_basis(directions @ rotation, degree)
    out = sh.copy()
    for band in range(1, degree + 1):
        part = slice(band * band, (band + 1) ** 2)
        change = np.linalg.lstsq(after[:, part], before[:, part], rcond=None)[0]
        out[:, part] = np.einsum("ab,nbc->nac", change, sh[:, part].astype(np.float64))
    return out


def _spread(count: int) -> F64:
    """(count, 3) unit vectors on a spiral from pole to pole."""
    z = 1 - (2 * np.arange(count) + 1) / count
    angle = _GOLDEN_ANGLE * np.arange(count)
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
