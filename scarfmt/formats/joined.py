"""Several scenes as one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scarfmt.arrays import F32
from scarfmt.scene.gaussians import GaussianScene


def joined(parts: Sequence[GaussianScene]) -> GaussianScene:
    """One scene of one or more; a part of a lower SH degree gets zeros above it."""
    coefficients = max(part.sh.shape[1] for part in parts)
    return GaussianScene(
        np.concatenate([part.positions for part in parts]),
        np.concatenate([part.log_scales for part in parts]),
        np.concatenate([part.rotations for part in parts]),
        np.concatenate([part.opacity_logits for part in parts]),
        np.concatenate([_widened(part.sh, coefficients) for part in parts]),
    )


def _widened(sh: F32, coefficients: int) -> F32:
    return np.pad(sh, ((0, 0), (0, coefficients - sh.shape[1]), (0, 0)))
