"""Gaussians turned, scaled and moved; and spherical harmonics (SPEC §9.4): what they are in a direction, and turned."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from scarfmt.arrays import F32, F64
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.scene.rotation import matrix_from_quaternion, quaternion_from_matrix

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


def turn_bands(rotation: F64, degree: int) -> F64:
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
            ValueError: it is none, with the reason.
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

    def scene(self, scene: GaussianScene) -> GaussianScene:
        """The Gaussians placed: sizes, orientations and view-dependent colours go with them."""
        grown = (scene.log_scales + np.float32(math.log(self.scale))).astype(np.float32)
        rotations = _product(self._quaternion, scene.rotations)
        return replace(
            scene,
            positions=self.points(scene.positions),
            log_scales=grown,
            rotations=rotations,
            sh=self._harmonics(scene.sh),
        )

    @cached_property
    def _quaternion(self) -> F64:
        return np.asarray(quaternion_from_matrix(self.rotation[None])[0])

    @cached_property
    def _bands(self) -> list[F64]:
        return [turn_bands(self.rotation, degree) for degree in range(4)]

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


def _product(first: F64, quaternions: F32) -> F32:
    """(N, 4) float32: the rotations `quaternions` (N, 4), each followed by `first` (4,)."""
    a, b, c, d = (float(x) for x in first)
    w, x, y, z = quaternions.astype(np.float64).T
    rows = [a * w - b * x - c * y - d * z, a * x + b * w + c * z - d * y]
    rows += [a * y - b * z + c * w + d * x, a * z + b * y - c * x + d * w]
    return np.stack(rows, axis=1).astype(np.float32)


def compose(translation: Sequence[float], rotation: Sequence[float], scale: Sequence[float]) -> F64:
    """The (4, 4) matrix of a node of a scene graph, which scales, then turns, then moves.

    Args:
        translation: 3 numbers.
        rotation: a quaternion x, y, z, w; its length does not count.
        scale: of each axis.
    """
    x, y, z, w = rotation
    matrix = np.eye(4)
    matrix[:3, :3] = matrix_from_quaternion(np.array([[w, x, y, z]]))[0] * np.asarray(scale)
    matrix[:3, 3] = translation
    return matrix


def place_scene(scene: GaussianScene, matrix: F64) -> GaussianScene:
    """The scene where a node of a scene graph puts it: means, covariances and colours.

    Args:
        scene: in the axes of the node.
        matrix: (4, 4), made of a translation, a rotation and a scale of each axis.

    Raises:
        ValueError: the matrix is made of something else.
    """
    if np.array_equal(matrix, np.eye(4)):
        return scene
    lengths = np.linalg.norm(matrix[:3, :3], axis=0)
    uniform = bool(np.ptp(lengths) <= TOLERANCE * lengths.max())
    rest = matrix.copy()
    if not uniform:
        rest[:3, :3] /= np.where(lengths > 0, lengths, 1.0)
    try:
        placement = Placement.of(rest.tolist())
    except np.linalg.LinAlgError as error:
        raise ValueError(str(error)) from error
    with np.errstate(over="ignore", invalid="ignore"):  # what overflows is not finite, which a later check reports
        return placement.scene(scene if uniform else _stretch(scene, lengths))


def _stretch(scene: GaussianScene, lengths: F64) -> GaussianScene:
    """The scene scaled along each axis: ellipsoids become other ellipsoids, colours stay."""
    log_scales = scene.log_scales.astype(np.float64)
    # As matrices of moderate size, so that neither tiny nor huge ellipsoids leave the range of float64.
    largest = log_scales.max(axis=1, keepdims=True)
    sides = matrix_from_quaternion(scene.rotations) * np.exp(log_scales - largest)[:, None, :]
    axes, stretched, _ = np.linalg.svd(lengths[:, None] * sides)
    axes[:, :, 2] *= np.sign(np.linalg.det(axes))[:, None]
    with np.errstate(divide="ignore"):
        grown = (np.log(stretched) + largest).astype(np.float32)
    quaternions = quaternion_from_matrix(axes).astype(np.float32)
    return replace(scene, positions=scene.positions * lengths, log_scales=grown, rotations=quaternions)
