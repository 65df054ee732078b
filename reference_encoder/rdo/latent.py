"""Projecting vectors to a decorrelated latent and back (encoder side of SPEC §9.2).

The weighted Karhunen-Loève basis: its first dimensions hold most of the visible energy, the last are
dropped when they hold less than quantisation would leave anyway.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from reference_encoder.tuning import DECODER_BITS, LATENT_RANGE, MAX_DIMENSIONS
from scarfmt.arrays import F32, F64
from scarfmt.blocks.mlp import Linear, QuantisedMlp

_ROWS = 4096
"""Vectors at a time."""


@dataclass(frozen=True)
class Latent:
    """A linear latent.

    Attributes:
        values: (N, d) float32 in lattice units.
        weight: (N,) float64: squared picture error per squared lattice unit.
        decoder: the network of SPEC §9.2, lattice units in, coefficients out.
        projection: (D, d) float64 from centred vectors to latents.
    """

    values: F32
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
    centre, root, inverse = np.zeros(vectors.shape[1]), np.eye(vectors.shape[1]), np.eye(vectors.shape[1])
    if metric is not None:
        centre = (weight @ vectors) / max(float(weight.sum()), 1e-300)
        values, axes = np.linalg.eigh(metric)
        # A floor under the eigenvalues: the square root has an inverse.
        values = np.sqrt(np.maximum(values, float(values.max()) * 1e-6))
        root, inverse = (axes * values) @ axes.T, (axes / values) @ axes.T
    moments = np.zeros_like(root)
    for rows, x in _blocks(vectors, centre):
        moments += (x * weight[rows, None]).T @ x
    energy, basis = np.linalg.eigh(root @ moments @ root)
    energy, basis = energy[::-1], basis[:, ::-1]
    left = np.concatenate([np.cumsum(energy[::-1])[::-1], [0.0]])
    keep = min(int(np.argmax(left <= tolerance)), MAX_DIMENSIONS)
    if keep == 0:
        return None
    basis = basis[:, :keep] * np.sign(basis[np.abs(basis).argmax(axis=0), np.arange(basis.shape[1])])[:keep]
    projection, z = root @ basis, np.empty((len(vectors), keep), np.float32)
    for rows, x in _blocks(vectors, centre):
        z[rows] = x @ projection
    unit = max(float(np.percentile(np.abs(z), 99.9, overwrite_input=True)) / LATENT_RANGE, 1e-12)
    z /= unit
    decoder = QuantisedMlp((Linear.quantise(inverse @ basis * unit, centre, bits=DECODER_BITS),))
    return Latent(z, weight * unit * unit, decoder, projection / unit)


def _blocks(vectors: F32, centre: F64) -> Iterator[tuple[slice, F64]]:
    """Rows, and (n, D) float64 of them less `centre`: few at a time stay in the cache."""
    for first in range(0, len(vectors), _ROWS):
        rows = slice(first, first + _ROWS)
        yield rows, vectors[rows] - centre
