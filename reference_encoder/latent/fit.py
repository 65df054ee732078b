"""The latent an encoder uses: linear, or the paper's learned autoencoder (docs/decisions/0005-latent.md)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from reference_encoder.decide.assemble import codebook_size
from reference_encoder.latent.linear import Latent, linear_latent
from reference_encoder.latent.rvq import RvqOptions, RvqResult, Vectors, quantise
from reference_encoder.options import EFFORTS, EncodeOptions
from scarfmt.coding.writer import Report

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]


def fit_latent(
    vectors: NDArray[np.float32],
    weight: F64,
    classes: I64,
    rate: float,
    extra_stages: int,
    options: EncodeOptions,
    report: Report,
    metric: F64 | None = None,
) -> tuple[Latent, RvqResult] | tuple[None, None]:
    """Latent and codewords of (N, D) `vectors`; (None, None) when nothing in them is worth sending.

    Args:
        weight: (N,) squared picture error per squared unit.
        classes: (N,) class numbers.
        rate: lambda of the last layer.
        extra_stages: RVQ stages beyond the effort level's.
        metric: (D, D), which errors matter; None for all alike.
    """
    effort = EFFORTS[options.effort]
    stages = effort.stages + extra_stages
    rvq = RvqOptions(codebook_size(len(classes)), stages, rate, effort.sample, effort.epochs, options.seed)
    tolerance = rate * len(classes)

    def tell(fraction: float) -> None:
        report("codebooks", fraction)

    if options.latent == "learned":
        # These need torch.
        from reference_encoder.latent.autoencoder import AutoencoderOptions
        from reference_encoder.latent.learned import learned_latent

        learning = AutoencoderOptions(rvq, estimator=options.estimator)
        return learned_latent(vectors, weight, classes, tolerance, learning, metric, tell) or (None, None)
    latent = linear_latent(vectors, weight, tolerance, metric)
    if latent is None:
        return None, None
    return latent, quantise(Vectors(latent.values, latent.weight, classes), rvq, tell)
