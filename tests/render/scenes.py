"""Small made-up scenes and cameras for the rendering tests."""

from __future__ import annotations

import numpy as np

from scarfmt.render.camera import Camera
from scarfmt.scene.gaussians import GaussianScene


def random_scene(seed: int, count: int = 150, degree: int = 3) -> GaussianScene:
    """Gaussians of all sizes in front of, beside and behind the camera of :func:`small_camera`."""
    rng = np.random.default_rng(seed)
    positions = rng.uniform([-2, -2, -0.5], [2, 2, 6], (count, 3))
    log_scales = rng.uniform(-4.5, -0.3, (count, 3)).astype(np.float32)
    rotations = rng.normal(size=(count, 4)).astype(np.float32) * rng.uniform(0.1, 9, (count, 1)).astype(np.float32)
    logits = rng.uniform(-6, 6, count).astype(np.float32)
    sh = rng.normal(0, 0.3, (count, (degree + 1) ** 2, 3)).astype(np.float32)
    return GaussianScene(positions, log_scales, rotations, logits, sh)


def degenerate_scene(seed: int) -> GaussianScene:
    """A scene of :func:`random_scene` with the extremes of real files: see the assignments."""
    scene = random_scene(seed, 80)
    scene.rotations[0:10] = 0
    scene.rotations[10:14] *= np.float32(1e-30)
    scene.log_scales[14:24] = np.log(1e-20)
    scene.log_scales[24:30, 1:] = np.log(1e-20)
    scene.log_scales[30:33] = 3
    scene.opacity_logits[0:20:2] = 400
    scene.opacity_logits[1:21:2] = -400
    scene.positions[40:50] = scene.positions[50:60]
    scene.positions[60] = [0.0, 0.0, 0.0]
    scene.positions[61] = [0.0, 0.0, 0.21]
    scene.positions[62, 2] = 1e6
    scene.sh[63] = -50
    return scene


def small_camera(width: int = 45, height: int = 35) -> Camera:
    """An off-centre camera, a little turned, whose picture is no whole number of tiles."""
    angle = 0.15
    pose = np.eye(4)
    pose[:3, :3] = [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    pose[:3, 3] = [0.1, -0.2, 0.3]
    return Camera(width, height, 40.0, 42.0, 21.0, 18.5, pose, name="small")
