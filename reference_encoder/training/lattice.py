"""Distinct points of a lattice: what rows of integers there are, and which row is which."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor


class Distinct(NamedTuple):
    """The distinct ones of n points, ascending by x, then y, then z.

    Attributes:
        points: (m, 3) int64.
        which: (n,) int64 row of `points` of each.
        counts: (m,) int64 how often each is there.
    """

    points: Tensor
    which: Tensor
    counts: Tensor

    @classmethod
    def of(cls, points: Tensor) -> Distinct:
        """Build the lattice of (n, 3) int64 points whose box has fewer than 2^63 points; n >= 1.

        A number is sorted for each, and not rows: that is a hundred times as fast.
        """
        least = points.min(dim=0).values
        _, height, depth = ((points - least).max(dim=0).values + 1).unbind()
        x, y, z = (points - least).unbind(1)
        numbers, which, counts = torch.unique(
            (x * height + y) * depth + z, return_inverse=True, return_counts=True
        )
        rest = torch.div(numbers, depth, rounding_mode="floor")
        columns = torch.div(rest, height, rounding_mode="floor"), rest % height, numbers % depth
        return cls(torch.stack(columns, dim=1) + least, which, counts)
