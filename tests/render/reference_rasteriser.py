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
from scarfmt.scene.placement import sh_basis
from scarfmt.scene.rotation import matrix_from_quaternion


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
            direction = scene.positions[i] - camera.centre
            basis = sh_basis(direction / np.linalg.norm(direction), degree)
            colour = np.maximum(0.0, 0.5 + basis @ scene.sh[i, : len(basis)].astype(np.float64))
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
    axes = matrix_from_quaternion(scene.rotations[index][None])[0] * np.exp(scene.log_scales[index].astype(np.float64))
    projected = jacobian @ camera.world_to_camera[:3, :3] @ axes
    return np.asarray(projected @ projected.T + 0.3 * np.eye(2), dtype=np.float64)
