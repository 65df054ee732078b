"""A scene of any number of Gaussians from a real one, written while it is made: nothing of it is held.

It is copies of the real scene, side by side on the ground. Each is moved to a place of its own, and but for the first
also jittered (positions by about a tenth of a Gaussian's size, log-scales and opacities a little) and recoloured (one
gain for each colour of the copy, and a little noise). Numbers repeat nowhere; where there is more detail, and where
less, does.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.scenes import Scene
from scarfmt.atomic import atomic_write
from scarfmt.formats import load
from scarfmt.formats.clean import clean
from scarfmt.formats.export_ply import ply_header, ply_rows
from scarfmt.render.camera import core, upward_axes
from scarfmt.scene.gaussians import GaussianScene

SPACING = 2.4
"""Half extents of the core from copy to copy."""
_JITTER, _SCALE_JITTER, _OPACITY_JITTER, _COLOUR_JITTER, _GAIN = 0.1, 0.05, 0.1, 0.02, 0.3


def write_copies(source: Scene, count: int, path: Path, seed: int = 0) -> None:
    """Write a PLY of exactly `count` Gaussians, the last copy in part.

    Args:
        source: the real scene.
        count: Gaussians.
        path: of the PLY.
        seed: of all random choices.
    """
    scene, _ = clean(load(source.path), drop_invalid=True)
    assert isinstance(scene, GaussianScene)
    axes = upward_axes(source.up)
    step = SPACING * core(scene, axes[2])[1]
    columns = int(np.ceil(np.sqrt(-(-count // len(scene)))))
    with atomic_write(path) as stream:
        comments = [f"copies of {source.name}, moved, jittered and recoloured"]
        stream.write(ply_header(count, scene.sh.shape[1] - 1, comments))
        for number in range(-(-count // len(scene))):
            made = copy_of(scene, number, seed)
            place = step * ((number % columns) * axes[0] + (number // columns) * axes[1])
            part = replace(made, positions=made.positions + place).rows(slice(0, count - number * len(scene)))
            stream.write(ply_rows(part).data)


def copy_of(scene: GaussianScene, number: int, seed: int) -> GaussianScene:
    """A copy of a scene in its place; the first is the scene."""
    if number == 0:
        return scene
    random = np.random.default_rng([seed, number])
    size = np.exp(scene.log_scales.astype(np.float64)).mean(axis=1, keepdims=True)
    gain = np.exp(_GAIN * random.normal(size=3))
    colour = scene.sh * gain + _COLOUR_JITTER * random.normal(size=scene.sh.shape)
    return GaussianScene(
        scene.positions + _JITTER * size * random.normal(size=scene.positions.shape),
        (scene.log_scales + _SCALE_JITTER * random.normal(size=scene.log_scales.shape)).astype(np.float32),
        scene.rotations,
        (scene.opacity_logits + _OPACITY_JITTER * random.normal(size=len(scene))).astype(np.float32),
        colour.astype(np.float32),
    )
