"""Rotation, opacity and colour, from coded values to what renderers take and back (SPEC §9.3, §9.4)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F64, Floats
from scarfmt.container.schema import Stream
from scarfmt.scene.rotation import quaternion_from

MAX_LOG_OPACITY = -(2.0**-13)
"""Opacity 1 has no logit: ln(opacity) is capped here, where the logit is 9.01 (SPEC §9.4)."""


def log_opacities(logits: NDArray[np.floating]) -> F64:
    """(n,) float64 natural logarithms of the opacities of (n,) logits."""
    return np.asarray(-np.logaddexp(0.0, -logits.astype(np.float64)))


def opacity_logits(log_opacities: Floats) -> F64:
    """(n,) float64 logits of opacities given as natural logarithms: y - ln(1 - e^y) with y capped (SPEC §9.4)."""
    y = np.minimum(np.asarray(log_opacities, np.float64), MAX_LOG_OPACITY)
    # expm1: 1 - e^y would cancel for y near 0.
    return np.asarray(y - np.log(-np.expm1(y)), np.float64)


def colour_from_spherical_harmonics(rgb: Floats) -> F64:
    """(n, 3) float64 coded (Y, G, O) of (n, 3) degree-0 coefficients R, G, B."""
    r, g, b = np.asarray(rgb, np.float64).T
    return np.stack([(r + 2 * g + b) / 4, (2 * g - r - b) / 4, (r - b) / 2], axis=1)


def spherical_harmonics_from_colour(colours: Floats) -> Floats:
    """(n, 3) degree-0 coefficients R, G, B of (n, 3) coded (Y, G, O) (SPEC §9.4)."""
    y, green, orange = colours.T
    return np.stack([y - green + orange, y + green, y - green - orange], axis=1)


def activate(values: Mapping[Stream, Floats], count: int, dtype: type) -> tuple[Floats, F64, Floats]:
    """Quaternions, opacity logits and degree-0 coefficients of explicit anchors (SPEC §9.3, §9.4).

    Args:
        values: (n, components) of ROTATION, OPACITY and COLOUR; those that are not there count as 0.
        count: n.
        dtype: what is computed in, float32 or float64; logits always in float64.

    Returns:
        (n, 4) unit quaternions (w, x, y, z), (n,) logits, (n, 3) coefficients of red, green and blue.
    """

    def given(stream: Stream, components: int) -> NDArray[Any]:
        found = values.get(stream)
        return np.zeros((count, components), dtype) if found is None else found.astype(dtype, copy=False)

    rotation = given(Stream.ROTATION, 3)
    with np.errstate(over="ignore", invalid="ignore"):
        quaternions = quaternion_from(rotation[:, :2], rotation[:, 2])
    logits = opacity_logits(given(Stream.OPACITY, 1)[:, 0])
    return quaternions, logits, spherical_harmonics_from_colour(given(Stream.COLOUR, 3))
