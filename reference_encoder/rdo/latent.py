"""Projecting vectors to a decorrelated latent and back (encoder side of SPEC §9.2).

The weighted Karhunen-Loève basis: its first dimensions hold most of the visible energy, the last are
dropped when they hold less than quantisation would leave anyway.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from reference_encoder.tuning import DECODER_BITS, LATENT_RANGE, MAX_DIMENSIONS
from scarfmt.arrays import F32, F64
from scarfmt.blocks.mlp import Linear, QuantisedMlp


@dataclass(frozen=True)
class Latent:
    """A linear latent.

    Attributes:
        values: (N, d) float64 in lattice units.
        weight: (N,) float64: squared picture error per squared lattice unit.
        decoder: the network of SPEC §9.2, lattice units in, coefficients out.
        projection: (D, d) float64 from vectors, centred and turned into the metric if there is one, to latents.
    """

    values: F64
    weight: F64
    decoder: QuantisedMlp
    projection: F64


def fit_latent(vectors: F32, weight: F64, tolerance: float, metric: F64 | None = None) -> Latent | None:
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
    unit = max(float(np.percentile(np.abs(z), 99.9)) / LATENT_RANGE, 1e-12)
    decoder = QuantisedMlp((Linear.quantised(inverse @ basis * unit, centre, bits=DECODER_BITS),))
    return Latent(z / unit, weight * unit * unit, decoder, basis / unit)


def metric_roots(metric: F64) -> tuple[F64, F64]:
    """Symmetric square root of `metric` and its inverse, with a floor under the eigenvalues."""
    values, vectors = np.linalg.eigh(metric)
    values = np.sqrt(np.maximum(values, float(values.max()) * 1e-6))
    return (vectors * values) @ vectors.T, (vectors / values) @ vectors.T
