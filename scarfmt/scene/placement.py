"""Turning, scaling and moving Gaussians as a whole (SPEC §17, R-17-6 and R-17-11)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scarfmt.arrays import F32, F64
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.scene.harmonics import turned
from scarfmt.scene.rotation import quaternion_from_matrix

MOST = 2.0**60
"""Numbers of a transform are below it, and its scale is at most it and at least 1 / MOST."""
TOLERANCE = 1e-4
"""How far A^T A / s^2 may be from the identity: what is left of a rotation in binary32."""


@dataclass(frozen=True)
class Placement:
    """x' = linear @ x + translation, where linear is scale * rotation but for what rounding left of it.

    Attributes:
        linear: (3, 3) float64.
        scale: above 0.
        rotation: (3, 3) float64, determinant 1.
        translation: (3,) float64.
    """

    linear: F64
    scale: float
    rotation: F64
    translation: F64

    @classmethod
    def of(cls, rows: Sequence[Sequence[float]]) -> Placement:
        """The placement that a 4 x 4 matrix is, given by rows.

        Raises:
            ValueError: it is none, with the reason (R-17-6).
        """
        matrix = np.array(rows, np.float64)
        if not bool((np.abs(matrix) < MOST).all()):
            raise ValueError("a number of 2^60 or more")
        if matrix[3].tolist() != [0, 0, 0, 1]:
            raise ValueError("the last row is not 0, 0, 0, 1")
        upper = matrix[:3, :3]
        determinant = float(np.linalg.det(upper))
        scale = math.cbrt(determinant)
        if not 1 / MOST <= scale <= MOST:
            raise ValueError("it mirrors, flattens or scales beyond all measure")
        if not bool((np.abs(upper.T @ upper / scale**2 - np.eye(3)) <= TOLERANCE).all()):
            raise ValueError("it is no rotation with one scale")
        # The rotation nearest to it: what rounding left over would add up in what is turned.
        left, _, right = np.linalg.svd(upper / scale)
        return cls(upper, scale, left @ right, matrix[:3, 3])

    def points(self, points: F64) -> F64:
        """(..., 3) points placed."""
        return _times(self.linear, points) + self.translation

    def points_back(self, points: F64) -> F64:
        """(..., 3) points in the coordinates of what is placed."""
        return _times(self._inverse, points - self.translation)

    def directions_back(self, directions: F64) -> F64:
        """(..., 3) directions, of the same lengths, in the coordinates of what is placed."""
        return _times(self.rotation.T, directions)

    def box(self, low: F64, high: F64) -> tuple[F64, F64]:
        """The corners (3,) of the box along the axes round a placed box."""
        corners = self.points(_corners(low, high))
        return corners.min(axis=0), corners.max(axis=0)

    def box_back(self, low: F64, high: F64) -> tuple[F64, F64]:
        """The corners (3,) of a box that holds all that comes to lie in a box, in the coordinates of what is placed."""
        corners = self.points_back(_corners(low, high))
        # Rounding must not leave out what lies on a side.
        slack = 1e-12 * (np.abs(corners).max() + float(np.linalg.norm(self.translation)) / self.scale)
        return corners.min(axis=0) - slack, corners.max(axis=0) + slack

    def scene(self, scene: GaussianScene) -> GaussianScene:
        """The Gaussians placed: sizes, orientations and view-dependent colours go with them."""
        grown = (scene.log_scales + np.float32(math.log(self.scale))).astype(np.float32)
        rotations = _product(self._quaternion, scene.rotations)
        return GaussianScene(
            self.points(scene.positions), grown, rotations, scene.opacity_logits, self._harmonics(scene.sh)
        )

    @cached_property
    def _inverse(self) -> F64:
        return np.asarray(np.linalg.inv(self.linear), np.float64)

    @cached_property
    def _quaternion(self) -> F64:
        return np.asarray(quaternion_from_matrix(self.rotation[None])[0])

    @cached_property
    def _bands(self) -> list[F64]:
        return [turned(self.rotation, degree) for degree in range(4)]

    def _harmonics(self, sh: F32) -> F32:
        """(N, (degree + 1)^2, 3) coefficients that give towards `rotation` @ d what they gave towards d."""
        out = sh.copy()
        for degree in range(1, math.isqrt(sh.shape[1])):
            band = slice(degree**2, (degree + 1) ** 2)
            out[:, band] = np.einsum("ij,njc->nic", self._bands[degree].astype(np.float32), sh[:, band])
        return out


def _times(matrix: F64, points: F64) -> F64:
    """(..., 3) points, each times a matrix: the same bits whichever other points are there, unlike with BLAS."""
    x, y, z = (points[..., axis, None] for axis in range(3))
    with np.errstate(over="ignore", invalid="ignore"):  # coordinates may be any finite numbers
        return np.asarray(x * matrix[:, 0] + y * matrix[:, 1] + z * matrix[:, 2])


def _corners(low: F64, high: F64) -> F64:
    """(8, 3) corners of a box."""
    return np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])


def _product(first: F64, quaternions: F32) -> F32:
    """(N, 4) float32: the rotations `quaternions` (N, 4), each followed by `first` (4,)."""
    a, b, c, d = (float(x) for x in first)
    w, x, y, z = quaternions.astype(np.float64).T
    rows = [a * w - b * x - c * y - d * z, a * x + b * w + c * z - d * y]
    rows += [a * y - b * z + c * w + d * x, a * z + b * y - c * x + d * w]
    return np.stack(rows, axis=1).astype(np.float32)
