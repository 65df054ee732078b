"""Literal float64 renderer of the rules of :mod:`scarfmt.render.rasterise`, one pixel at a time.

Slow and readable on purpose: the oracle of the tests. It shares no code with the rasteriser.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F64
from scarfmt.render.camera import Camera
from scarfmt.scene.gaussians import GaussianScene


@dataclass(frozen=True)
class Ellipse:
    """One Gaussian as a camera sees it: `index` in the scene, float32 `depth`, pixel `mean`, inverse covariance."""

    index: int
    depth: np.float32
    mean: F64
    conic: F64
    opacity: float
    colour: F64


def render_reference(
    scene: GaussianScene,
    camera: Camera,
    background: Sequence[float] = (0.0, 0.0, 0.0),
    sh_degree: int | None = None,
    colours: NDArray[np.floating] | None = None,
) -> F64:
    """The picture of a scene, (height, width, 3) float64; arguments as :func:`scarfmt.render.rasterise.render`."""
    ellipses = visible_ellipses(scene, camera, sh_degree, colours)
    image = np.empty((camera.height, camera.width, 3))
    for row in range(camera.height):
        for column in range(camera.width):
            blends, transmittance = pixel_blends(ellipses, column, row)
            image[row, column] = transmittance * np.asarray(background, dtype=np.float64)
            for ellipse, alpha, before in blends:
                image[row, column] += alpha * before * ellipse.colour
    return image


def pixel_blends(ellipses: list[Ellipse], column: int, row: int) -> tuple[list[tuple[Ellipse, float, float]], float]:
    """The blends at one pixel, nearest first: (ellipse, alpha, transmittance before it), and the rest of the
    transmittance."""
    blends = []
    transmittance = 1.0
    for ellipse in ellipses:
        offset = np.array([column + 0.5, row + 0.5]) - ellipse.mean
        power = -0.5 * float(offset @ ellipse.conic @ offset)
        if power > 0:
            continue
        alpha = min(0.99, ellipse.opacity * math.exp(power))
        if alpha < 1 / 255:
            continue
        if transmittance * (1 - alpha) < 1e-4:
            break
        blends.append((ellipse, alpha, transmittance))
        transmittance *= 1 - alpha
    return blends, transmittance


def visible_ellipses(
    scene: GaussianScene,
    camera: Camera,
    sh_degree: int | None = None,
    colours: NDArray[np.floating] | None = None,
) -> list[Ellipse]:
    """All Gaussians in front of the near plane with a finite shape, nearest first, ties by index."""
    degree = scene.sh_degree if sh_degree is None else min(sh_degree, scene.sh_degree)
    rotation, translation = camera.world_to_camera[:3, :3], camera.world_to_camera[:3, 3]
    ellipses = []
    for i in range(len(scene)):
        local = rotation @ scene.positions[i] + translation
        if not camera.near < local[2] < np.inf:
            continue
        covariance = covariance_2d(scene, i, camera, local)
        determinant = covariance[0, 0] * covariance[1, 1] - covariance[0, 1] ** 2
        if not 0 < determinant < np.inf:
            continue
        adjugate = np.array([[covariance[1, 1], -covariance[0, 1]], [-covariance[0, 1], covariance[0, 0]]])
        mean = np.array([camera.fx * local[0] / local[2] + camera.cx, camera.fy * local[1] / local[2] + camera.cy])
        if colours is None:
            colour = sh_colour(scene.sh[i].astype(np.float64), scene.positions[i] - camera.centre, degree)
        else:
            colour = colours[i].astype(np.float64)
        opacity = sigmoid(float(scene.opacity_logits[i]))
        ellipses.append(Ellipse(i, np.float32(local[2]), mean, adjugate / determinant, opacity, colour))
    return sorted(ellipses, key=lambda ellipse: (ellipse.depth, ellipse.index))


def sigmoid(logit: float) -> float:
    """1 / (1 + exp(-logit)) without overflow."""
    return 1 / (1 + math.exp(-logit)) if logit >= 0 else math.exp(logit) / (1 + math.exp(logit))


def covariance_2d(scene: GaussianScene, index: int, camera: Camera, local: F64) -> F64:
    """(2, 2) float64 covariance in the picture, pixels^2, with INRIA's frustum clamp and 0.3 pixel dilation."""
    limit_x = 1.3 * camera.width / (2 * camera.fx)
    limit_y = 1.3 * camera.height / (2 * camera.fy)
    x, y, z = local
    tx = min(limit_x, max(-limit_x, x / z)) * z
    ty = min(limit_y, max(-limit_y, y / z)) * z
    jacobian = np.array([[camera.fx / z, 0, -camera.fx * tx / z**2], [0, camera.fy / z, -camera.fy * ty / z**2]])
    axes = rotation_matrix(scene.rotations[index].astype(np.float64)) * np.exp(
        scene.log_scales[index].astype(np.float64)
    )
    projected = jacobian @ camera.world_to_camera[:3, :3] @ axes
    return np.asarray(projected @ projected.T + 0.3 * np.eye(2), dtype=np.float64)


def rotation_matrix(quaternion: F64) -> F64:
    """(3, 3) float64 of the quaternion w, x, y, z; any length, and zero stands for no rotation."""
    if not quaternion.any():
        return np.eye(3)
    w, x, y, z = quaternion / np.abs(quaternion).max() / np.linalg.norm(quaternion / np.abs(quaternion).max())
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def sh_colour(sh: F64, direction: F64, degree: int) -> F64:
    """(3,) float64 colour max(0, 0.5 + sum of coefficients * basis) seen along `direction` (need not be a unit)."""
    x, y, z = direction / np.linalg.norm(direction)
    pi = math.pi
    basis = [
        0.5 * math.sqrt(1 / pi),
        -math.sqrt(3 / (4 * pi)) * y,
        math.sqrt(3 / (4 * pi)) * z,
        -math.sqrt(3 / (4 * pi)) * x,
        0.5 * math.sqrt(15 / pi) * x * y,
        -0.5 * math.sqrt(15 / pi) * y * z,
        0.25 * math.sqrt(5 / pi) * (3 * z * z - 1),
        -0.5 * math.sqrt(15 / pi) * x * z,
        0.25 * math.sqrt(15 / pi) * (x * x - y * y),
        -0.25 * math.sqrt(35 / (2 * pi)) * y * (3 * x * x - y * y),
        0.5 * math.sqrt(105 / pi) * x * y * z,
        -0.25 * math.sqrt(21 / (2 * pi)) * y * (5 * z * z - 1),
        0.25 * math.sqrt(7 / pi) * z * (5 * z * z - 3),
        -0.25 * math.sqrt(21 / (2 * pi)) * x * (5 * z * z - 1),
        0.25 * math.sqrt(105 / pi) * z * (x * x - y * y),
        -0.25 * math.sqrt(35 / (2 * pi)) * x * (x * x - 3 * y * y),
    ]
    used = (degree + 1) ** 2
    return np.asarray(np.maximum(0.0, 0.5 + np.array(basis[:used]) @ sh[:used]), dtype=np.float64)
