"""The latent an encoder uses: linear, or the paper's learned autoencoder (docs/decisions/0005-latent.md)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from reference_encoder.latent.linear import Latent, linear_latent
from reference_encoder.latent.rvq import RvqOptions, RvqResult, Vectors, quantise
from reference_encoder.options import EFFORTS, EncodeOptions
from reference_encoder.tuning import ANCHORS_PER_CODEWORD, FEWEST_CODEWORDS_LOG2, MOST_CODEWORDS_LOG2
from scarfmt.arrays import F32, F64, I64
from scarfmt.coding.writer import Report
from scarfmt.scene.codebooks import Codebooks


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """The vectors that a latent must represent, and their weights.

    Attributes:
        vectors: (N, D) float32.
        weight: (N,) float64 squared picture error per squared unit.
        classes: (N,) class numbers; the price of a code depends on it.
        lambda_: of the last layer, squared picture error per bit.
        metric: (D, D), which errors matter; None for all alike.
        extra_stages: RVQ stages beyond the effort level's.
        repeat: how many vectors each stands for.
    """

    vectors: F32
    weight: F64
    classes: I64
    lambda_: float
    metric: F64 | None = None
    extra_stages: int = 0
    repeat: float = 1.0


@dataclass(frozen=True)
class FittedLatent:
    """Latents of all anchors, and the codewords chosen for them at static prices."""

    latent: Latent
    rvq: RvqResult

    @property
    def books(self) -> Codebooks:
        """Both codebooks, as files hold them."""
        return Codebooks(self.rvq.coarse, self.rvq.residual)


def codebook_size(anchors: int) -> int:
    """Codewords that pay for themselves, a power of two."""
    size = np.round(np.log2(max(anchors, 1) / ANCHORS_PER_CODEWORD))
    return int(2 ** np.clip(size, FEWEST_CODEWORDS_LOG2, MOST_CODEWORDS_LOG2))


def fit_latent(wanted: Wanted, options: EncodeOptions, report: Report) -> FittedLatent | None:
    """Latent and codewords; None when nothing in the vectors is worth sending."""
    effort, count = EFFORTS[options.effort], len(wanted.classes)
    stages = effort.stages + wanted.extra_stages
    size = codebook_size(round(wanted.repeat * count))
    rvq = RvqOptions(size, stages, wanted.lambda_, effort.sample, effort.epochs, options.seed)
    tolerance = wanted.lambda_ * count

    def tell(fraction: float) -> None:
        report("codebooks", fraction)

    if options.latent == "learned":
        # These need torch.
        from reference_encoder.latent.autoencoder import AutoencoderOptions
        from reference_encoder.latent.learned import learned_latent

        learning = AutoencoderOptions(rvq, estimator=options.estimator)
        found = learned_latent(wanted.vectors, wanted.weight, wanted.classes, tolerance, learning, wanted.metric, tell)
        return None if found is None else FittedLatent(*found)
    latent = linear_latent(wanted.vectors, wanted.weight, tolerance, wanted.metric)
    if latent is None:
        return None
    return FittedLatent(latent, quantise(Vectors(latent.values, latent.weight, wanted.classes), rvq, tell))
