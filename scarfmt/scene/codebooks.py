"""Codewords of the residual vector quantiser, and what latents they add up to (SPEC §9.2).

Codebook 0 is the coarse one of stage 1, codebook 1 the residual one shared by all later stages. Codewords are
integers on one common scale, so the latent z = sum of codewords is exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import I64

MAX_CODEWORDS = 4096
MAX_LATENT = 64


@dataclass(frozen=True)
class Codebooks:
    """The two codebooks; an empty one has shape (0, d).

    Attributes:
        coarse: (n1, d) int64 codewords of stage 1.
        residual: (n2, d) int64 codewords of later stages.
    """

    coarse: I64
    residual: I64

    @property
    def dimension(self) -> int:
        """d, latent dimensions."""
        return int(self.coarse.shape[1])

    @property
    def sizes(self) -> tuple[int, int]:
        """Codewords in each book."""
        return len(self.coarse), len(self.residual)

    def latents(self, indices: NDArray[np.integer[Any]], stages: I64, columns: int | None = None) -> I64:
        """(n, d) int64 sums of the codewords of each anchor's first `stages` indices (SPEC §9.2).

        Args:
            indices: (n, M) int64.
            stages: (n,) int64 stages received, 0..M.
            columns: how many leading dimensions are wanted, None for all.
        """
        z = np.zeros((len(indices), self.dimension if columns is None else columns), np.int64)
        for stage in range(indices.shape[1]):
            chosen = np.flatnonzero(stages > stage)
            book = (self.residual if stage else self.coarse)[:, : z.shape[1]]
            if len(chosen) == len(z):
                z += book.take(indices[:, stage], axis=0)
            elif len(chosen):
                z[chosen] += book.take(indices[chosen, stage], axis=0)
        return z
