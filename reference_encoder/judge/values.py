"""Values of many anchors at once, without arrays in between: what pictures of results are drawn from (encoder only)."""

from __future__ import annotations

import numpy as np

from reference_encoder.jit import compiled
from scarfmt.arrays import F32, F64, I64, Ints
from scarfmt.blocks.mlp import QuantisedMlp
from scarfmt.scene.codebooks import Codebooks

_ROWS = 4096


@compiled
def rounded(true: F64, here: I64, classes: I64, widths: F64) -> F32:
    """(n, components) values of the anchors `here`, rounded to multiples of the widths of their classes; 0 for 0.

    Args:
        true: (N, components).
        here: (n,) rows of these.
        classes: (N,).
        widths: (classes, components).
    """
    out = np.zeros((len(here), true.shape[1]), np.float32)
    for k in range(len(here)):
        row, width = true[here[k]], widths[classes[here[k]]]
        for component in range(len(row)):
            if width[component] > 0:
                out[k, component] = np.rint(row[component] / width[component]) * width[component]
    return out


def applied(decoder: QuantisedMlp, latents: F32, out: F32) -> None:
    """Fill `out` (n, outputs) for (n, d) `latents`; what is between them stays in the cache."""
    for first in range(0, len(latents), _ROWS):
        out[first : first + _ROWS] = decoder.apply(latents[first : first + _ROWS], np.float32)


def codeword_sums(books: Codebooks, indices: Ints, stages: I64) -> F32:
    """(n, d) float32 sums of the codewords of each anchor's first `stages` indices; exact, as codewords are integers.

    Args:
        indices: (n, M).
        stages: (n,) stages received, 0..M.
    """
    coarse, residual = books.coarse.astype(np.float32), books.residual.astype(np.float32)
    return _codeword_sums(coarse, residual, np.asarray(indices), stages)


@compiled
def _codeword_sums(coarse: F32, residual: F32, indices: Ints, stages: I64) -> F32:
    out = np.zeros((len(indices), coarse.shape[1]), np.float32)
    for row in range(len(indices)):
        for stage in range(stages[row]):
            word = coarse[indices[row, stage]] if stage == 0 else residual[indices[row, stage]]
            for k in range(len(word)):
                out[row, k] += word[k]
    return out
