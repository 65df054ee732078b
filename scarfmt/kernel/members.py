"""The codewords of clusters as the compiled library reads them, and powers of two (SPEC §10.1, §10.5)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F32
from scarfmt.kernel.structs import Members
from scarfmt.neural.tables import exp2_table

LANES = 16
"""Columns of logits that are worked on together."""
# A logit so far below all others has no weight.
_NEVER = -float(1 << 25)


@cache
def exp2_weights() -> NDArray[np.uint32]:
    """The table of SPEC §10.1 as the library reads it."""
    return exp2_table().astype(np.uint32)


class PackedMembers:
    """The codewords of each cluster of a two-level head (SPEC §10.5).

    Attributes:
        sizes: (clusters,) int64 members of each.

    Args:
        weights: per cluster (width, members) float32.
        offsets: per cluster (members,) float32.
    """

    def __init__(self, weights: Sequence[F32], offsets: Sequence[F32]) -> None:
        self.sizes = np.array([len(part) for part in offsets])
        filled = -(-self.sizes // LANES) * LANES
        self._starts, self._places = (np.concatenate(([0], np.cumsum(sizes))) for sizes in (self.sizes, filled))
        more = filled - self.sizes
        wide = [np.pad(part, ((0, 0), (0, fill))) for part, fill in zip(weights, more, strict=True)]
        self._weights = np.concatenate([np.ascontiguousarray(part, np.float32).ravel() for part in wide])
        rows = [np.pad(part, (0, fill), constant_values=_NEVER) for part, fill in zip(offsets, more, strict=True)]
        self._offsets = np.concatenate(rows).astype(np.float32)
        arrays = self._starts, self._places, self._weights, self._offsets
        addresses = (array.ctypes.data for array in arrays)
        self.struct = Members(len(self.sizes), len(weights[0]), int(filled.max()), *addresses)
