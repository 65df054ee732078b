"""Orientation of a Gaussian as three numbers: normal (u, v) and twist (SPEC §9.3).

An ellipsoid does not care which of its axes comes first nor which way they point. So axes are sorted by
scale, longest first; the *normal* is the shortest axis, turned into the upper hemisphere and mapped to
the square [-1, 1]^2 (octahedral map, rotated by 45 degrees); the *twist* is the angle of the longest axis
about it, in [-pi/2, pi/2), from a reference direction fixed by the normal. Sorting and sign freedom are
worth 4.6 bits a Gaussian, and an axis pair of equal scales needs no twist bits at all.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F64


def matrix_from_quaternion(quaternions: NDArray[np.floating]) -> F64:
    """(N, 3, 3) float64 rotation matrices of (N, 4) w, x, y, z; a zero quaternion is the identity."""
    q = np.asarray(quaternions, np.float64)
    largest = np.abs(q).max(axis=1, keepdims=True)
    q = np.where(largest > 0, q / np.where(largest > 0, largest, 1.0), np.array([1.0, 0, 0, 0]))
    w, x, y, z = (q / np.linalg.norm(q, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1)


def quaternion_from_matrix(matrices: F64) -> F64:
    """(N, 4) float64 unit quaternions w, x, y, z with w >= 0 of (N, 3, 3) rotation matrices."""
    m = matrices
    diagonal = [m[:, 0, 0], m[:, 1, 1], m[:, 2, 2]]
    trace = diagonal[0] + diagonal[1] + diagonal[2]
    # Four times the squares of w, x, y, z; the column of the largest is divided by, never by a small one.
    squares = np.stack([1 + trace] + [1 + 2 * d - trace for d in diagonal], axis=1)
    a, b, c = m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]
    xy, xz, yz = m[:, 0, 1] + m[:, 1, 0], m[:, 0, 2] + m[:, 2, 0], m[:, 1, 2] + m[:, 2, 1]
    products = np.stack(
        [
            np.stack([squares[:, 0], a, b, c], axis=1),
            np.stack([a, squares[:, 1], xy, xz], axis=1),
            np.stack([b, xy, squares[:, 2], yz], axis=1),
            np.stack([c, xz, yz, squares[:, 3]], axis=1),
        ],
        axis=1,
    )
    q = products[np.arange(len(m)), squares.argmax(axis=1)]
    q = q / np.linalg.norm(q, axis=1, keepdims=True)
    return np.asarray(np.where(q[:, :1] < 0, -q, q))


def _reference_frame(normal: F64) -> tuple[F64, F64]:
    """Two unit vectors completing `normal` (upper hemisphere) to a right-handed frame, continuous in it."""
    x, y, z = normal.T
    a = -1 / (1 + z)
    b = x * y * a
    return np.stack([1 + x * x * a, b, -x], axis=1), np.stack([b, 1 + y * y * a, -y], axis=1)


def _normal_from_square(square: F64) -> F64:
    # u, v and 1 divided by a power of two: the same bits, but no sum or square above overflows, also in float32.
    shift = np.maximum(np.frexp(np.abs(square).max(axis=1, initial=0))[1] - 1, 0)
    one = np.ldexp(square.dtype.type(1), -shift)
    u, v = np.ldexp(square, -shift[:, None]).T
    px, py = (u + v) / 2, (u - v) / 2
    normal = np.stack([px, py, one - np.abs(px) - np.abs(py)], axis=1)
    return np.asarray(normal / np.linalg.norm(normal, axis=1, keepdims=True))


def sort_axes(log_scales: NDArray[np.floating], quaternions: NDArray[np.floating]) -> tuple[F64, F64]:
    """Ellipsoids described again with axes sorted by scale, longest first (ties keep their order).

    Returns:
        (N, 3) float64 log scales, descending, and (N, 3, 3) float64 matrices whose columns are the axes
        (the third may point either way: handedness is not kept).
    """
    order = np.argsort(-np.asarray(log_scales, np.float64), axis=1, kind="stable")
    matrices = matrix_from_quaternion(quaternions)
    axes = np.take_along_axis(matrices, order[:, None, :], axis=2)
    return np.take_along_axis(np.asarray(log_scales, np.float64), order, axis=1), axes


def normal_and_twist(axes: F64) -> tuple[F64, F64]:
    """(N, 2) float64 normal square coordinates and (N,) float64 twist of (N, 3, 3) sorted axes."""
    normal = axes[:, :, 2]
    normal = np.where(normal[:, 2:] < 0, -normal, normal)
    p = normal[:, :2] / np.abs(normal).sum(axis=1, keepdims=True)
    square = np.stack([p[:, 0] + p[:, 1], p[:, 0] - p[:, 1]], axis=1)
    first, second = _reference_frame(normal)
    longest = axes[:, :, 0]
    angle = np.arctan2((longest * second).sum(1), (longest * first).sum(1))
    return square, (angle + np.pi / 2) % np.pi - np.pi / 2


def quaternion_from(square: F64, twist: F64) -> F64:
    """(N, 4) unit quaternions w, x, y, z, w >= 0, of normal square coordinates and twist (SPEC §9.3).

    Computed in the type of the arguments, float32 or float64, as a product: first by `twist` about z, then by the
    shortest way from z to the normal n, which is (1 + n_z, -n_y, n_x, 0) normalised. n_z stays above -0.82 for any
    square coordinates, so nothing vanishes.
    """
    x, y, z = _normal_from_square(square).T
    half = twist / 2
    cosine, sine = np.cos(half), np.sin(half)
    w = 1 + z
    length = np.sqrt(w * w + x * x + y * y)
    quaternions = np.stack([w * cosine, x * sine - y * cosine, x * cosine + y * sine, w * sine], axis=1)
    quaternions /= np.where(cosine < 0, -length, length)[:, None]
    return quaternions
