"""The codewords of clusters as the compiled library reads them, and powers of two (SPEC §10.1, §10.5)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import I64
from scarfmt.kernel.structs import Members
from scarfmt.kernel.words import PackedLayers, paired
from scarfmt.neural.arithmetic import half_step
from scarfmt.neural.tables import exp2_table

LANES = 16
"""Columns of logits that are worked on together."""


EXP2_WEIGHTS: NDArray[np.uint32] = exp2_table().astype(np.uint32)
"""The table of SPEC §10.1 as the library reads it, which has its address: it must never be made anew."""


class PackedMembers:
    """The codewords of each cluster of a two-level head (SPEC §10.5).

    Attributes:
        sizes: (clusters,) int64 members of each.

    Args:
        weights: (n, R) of the codewords, cluster after cluster.
        biases: (n,).
        sizes: of the clusters.
        shift: of the logits.
    """

    def __init__(self, weights: I64, biases: I64, sizes: Sequence[int], shift: int) -> None:
        self.sizes = np.array(sizes)
        blocks = -(-self.sizes // LANES)
        self._starts, self._places = (np.concatenate(([0], np.cumsum(counts))) for counts in (self.sizes, blocks))
        self._memory = PackedLayers()
        # The place of each codeword where every cluster begins with a block of its own.
        within = np.arange(len(weights)) - np.repeat(self._starts[:-1], self.sizes)
        place = np.repeat(self._places[:-1] * LANES, self.sizes) + within
        words = paired(weights)
        filled = np.zeros((int(self._places[-1]) * LANES, words.shape[1]), np.int32)
        offsets = np.zeros(len(filled), np.int64)
        filled[place], offsets[place] = words, biases + half_step(shift)
        rows = filled.reshape(-1, LANES, words.shape[1]).transpose(0, 2, 1)
        addresses = self._starts.ctypes.data, self._places.ctypes.data, self._memory.words(rows)
        counts = len(self.sizes), words.shape[1], int(blocks.max())
        self.struct = Members(*counts, *addresses, self._memory.words(offsets), shift)
