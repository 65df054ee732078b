"""Several scenes as one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scarfmt.arrays import F32
from scarfmt.scene.gaussians import GaussianScene


def together(parts: Sequence[GaussianScene]) -> GaussianScene:
    """One scene of one or more; a part of a lower SH degree gets zeros above it."""
    coefficients = max(part.sh.shape[1] for part in parts)
    return GaussianScene(
        np.concatenate([part.positions for part in parts]),
        np.concatenate([part.log_scales for part in parts]),
        np.concatenate([part.rotations for part in parts]),
        np.concatenate([part.opacity_logits for part in parts]),
        np.concatenate([widened(part.sh, coefficients) for part in parts]),
    )


def widened(sh: F32, coefficients: int) -> F32:
    """(N, coefficients, 3) spherical harmonics: zeros above their degree."""
    return np.pad(sh, ((0, 0), (0, coefficients - sh.shape[1]), (0, 0)))
