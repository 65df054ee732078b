"""Projecting vectors to a decorrelated latent and back (encoder side of SPEC §9.2).

The weighted Karhunen-Loève basis: its first dimensions hold most of the visible energy, the last are
dropped when they hold less than quantisation would leave anyway.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from reference_encoder.tuning import CODEWORD_RANGE, DECODER_BITS, MAX_DIMENSIONS
from scarfmt.arrays import F32, F64
from scarfmt.blocks.mlp import Linear, QuantisedMlp


@dataclass(frozen=True)
class Latent:
    """A linear latent.

    Attributes:
        values: (N, d) float32 in units of the codeword lattice.
        weight: (N,) float32: squared picture error per squared lattice unit.
        decoder: the network of SPEC §9.2, integers in, coefficients out.
        lost: (N,) float64 squared picture error of the dropped dimensions.
        projection: (D, d) float64 from vectors, centred and turned into the metric if there is one, to latents; None
            where that is not linear.
    """

    values: F32
    weight: F32
    decoder: QuantisedMlp
    lost: F64
    projection: F64 | None = None


def linear_latent(vectors: F32, weight: F64, tolerance: float, metric: F64 | None = None) -> Latent | None:
    """Weighted KLT of (N, D) `vectors`; None when nothing in them is worth sending.

    Args:
        weight: (N,) squared picture error per squared unit.
        tolerance: total squared picture error that may be dropped with dimensions.
        metric: (D, D) positive definite: an error e counts weight * e^T metric e. With a metric the vectors
            are also centred, their mean becoming the decoder's bias; without, it is the identity.
    """
    x = vectors.astype(np.float64)
    centre, inverse = np.zeros(x.shape[1]), np.eye(x.shape[1])
    if metric is not None:
        centre = (weight @ x) / max(float(weight.sum()), 1e-300)
        root, inverse = metric_roots(metric)
        x = (x - centre) @ root
    energy, basis = np.linalg.eigh((x * weight[:, None]).T @ x)
    energy, basis = energy[::-1], basis[:, ::-1]
    left = np.concatenate([np.cumsum(energy[::-1])[::-1], [0.0]])
    keep = min(int(np.argmax(left <= tolerance)), MAX_DIMENSIONS)
    if keep == 0:
        return None
    basis = basis[:, :keep] * np.sign(basis[np.abs(basis).argmax(axis=0), np.arange(basis.shape[1])])[:keep]
    z = x @ basis
    # The lattice is fine against what the most visible anchors can tell, coarse enough for short codewords.
    unit = max(float(np.percentile(np.abs(z), 99.9)) / CODEWORD_RANGE, 1e-12)
    decoder = QuantisedMlp((Linear.quantised(inverse @ basis * unit, centre, bits=DECODER_BITS),))
    lost = weight * np.maximum((x * x).sum(1) - (z * z).sum(1), 0.0)
    heavy = (weight * unit * unit).astype(np.float32)
    return Latent((z / unit).astype(np.float32), heavy, decoder, lost, basis / unit)


def metric_roots(metric: F64) -> tuple[F64, F64]:
    """Symmetric square root of `metric` and its inverse, with a floor under the eigenvalues."""
    values, vectors = np.linalg.eigh(metric)
    values = np.sqrt(np.maximum(values, float(values.max()) * 1e-6))
    return (vectors * values) @ vectors.T, (vectors / values) @ vectors.T
