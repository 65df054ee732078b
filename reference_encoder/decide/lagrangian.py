"""The encoder's one currency: lambda, squared picture error per bit (docs/decisions/0003, 0004; encoder side)."""

from __future__ import annotations

import numpy as np

from reference_encoder.tuning import LAMBDA_QUALITY_DB, LAMBDA_SLOPE
from scarfmt.arrays import F64


def lambda_for(quality: float, gaussians: int, offset_db: float) -> float:
    """Lambda of the last layer: squared picture error per bit that is predicted to give `quality` dB.

    Measured on the real scenes (docs/decisions/0004-rate-constant.md).

    Args:
        quality: dB.
        gaussians: of the source, or anchors.
        offset_db: at `LAMBDA_QUALITY_DB`, lambda times their number is so far below 1.
    """
    decibels = offset_db + (quality - LAMBDA_QUALITY_DB) / LAMBDA_SLOPE
    return 10 ** (-decibels / 10) / max(gaussians, 1)


def best_width(sensitivity: F64, lambda_: float) -> F64:
    """Quantiser cell whose last bit pays exactly: sqrt(6 * lambda / (ln 2 * S)), the high-rate optimum.

    Args:
        sensitivity: S, squared picture error per squared unit, of any shape.
        lambda_: squared picture error per bit.
    """
    return np.asarray(np.sqrt(6 * lambda_ / np.log(2) / np.maximum(sensitivity, 1e-300)))
