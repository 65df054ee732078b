"""Scenes with what real ones have and writers stumble over: outliers, saturated opacities, flat and tiny Gaussians."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from scarfmt.scene.gaussians import GaussianScene


def odd_scene(seed: int, count: int, degree: int, *, reach: float = 1e4) -> GaussianScene:
    """A scene of `count` Gaussians, an eighth of which are odd in each attribute.

    Args:
        seed: of its numbers.
        count: of its Gaussians.
        degree: of its spherical harmonics.
        reach: where outliers lie.
    """
    rng = np.random.default_rng(seed)

    def some() -> np.ndarray:
        return rng.random(count) < 1 / 8

    positions = rng.normal(size=(count, 3))
    positions[some()] *= reach / 4
    log_scales = rng.uniform(-12, 5, (count, 3))
    log_scales[some(), 2] = -400.0  # a size of zero
    rotations = rng.normal(size=(count, 4)) * 10.0 ** rng.uniform(-30, 15, (count, 1))
    rotations[some()] = 0.0
    logits = rng.normal(size=count) * 4
    logits[some()] = 400.0
    logits[some()] = -400.0
    sh = rng.normal(size=(count, (degree + 1) ** 2, 3)) * 0.4
    sh[some()] *= 12
    return GaussianScene(
        np.clip(positions, -reach, reach).astype(np.float32).astype(np.float64),
        log_scales.astype(np.float32),
        rotations.astype(np.float32),
        logits.astype(np.float32),
        sh.astype(np.float32),
    )


odd_scenes = st.builds(odd_scene, st.integers(0, 2**32), st.integers(1, 600), st.integers(0, 3))
"""Scenes of less than a chunk of a compressed PLY to more than two."""
