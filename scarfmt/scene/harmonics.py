"""Spherical harmonics as scenes have them (SPEC §9.4): what they are in a direction, and turned."""

from __future__ import annotations

import math

import numpy as np

from scarfmt.arrays import F64

_DIRECTIONS = 16
"""Directions that functions of one degree are compared in; 7 would determine those of degree 3."""


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


def turned(rotation: F64, degree: int) -> F64:
    """(2 * degree + 1, 2 * degree + 1) float64: what takes the coefficients of one degree with a rotation.

    Functions of a degree, turned, are functions of that degree: their values in enough directions say which.

    Args:
        rotation: (3, 3); what was seen towards d is seen towards rotation @ d.
        degree: 0..3.
    """
    directions = _sphere(_DIRECTIONS)
    band = slice(degree**2, (degree + 1) ** 2)
    here, there = sh_basis(directions, degree)[:, band], sh_basis(directions @ rotation, degree)[:, band]
    return np.asarray(np.linalg.lstsq(here, there, rcond=None)[0])


def _sphere(count: int) -> F64:
    """(count, 3) unit vectors, spread over the sphere along a spiral."""
    height = 1 - (2 * np.arange(count) + 1) / count
    around = np.arange(count) * (math.pi * (3 - math.sqrt(5)))
    radius = np.sqrt(1 - height * height)
    return np.stack([radius * np.cos(around), radius * np.sin(around), height], axis=1)
