"""The values of an anchor's neighbours as the file's predictors will see them: means over cells (SPEC §10.2).

The file has two cells about each anchor, of a few and of many anchors, and codes each anchor after some of the others
in it. Training sees all others: gradients do not run through them, so that it only matters what they are like.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from reference_encoder.training.lattice import Distinct
from reference_encoder.tuning import CONTEXT

OCCUPANCIES = CONTEXT.occupancies
"""Anchors that a cell shall hold on average, by depth."""


@dataclass(frozen=True)
class Neighbours:
    """Cells of N anchors.

    Attributes:
        cells: by depth, (N,) int64 number of the cell of each anchor.
        counts: by depth, (cells,) float32 anchors in each.
    """

    cells: tuple[Tensor, ...]
    counts: tuple[Tensor, ...]

    @classmethod
    def of(cls, lattice: Tensor) -> Neighbours:
        """Cells of (N, 3) int64 lattice points: the smallest cubes, twice as large each time, that hold enough."""
        found = [_cells(lattice, occupancy) for occupancy in OCCUPANCIES]
        counts = tuple(torch.bincount(cells).float() for cells in found)
        return cls(tuple(found), counts)

    def around(self, values: Tensor) -> Tensor:
        """(N, depths * (c + 1)) means of the others in each cell, and how full it is, of (N, c) values.

        Means are taken towards that of all anchors, as if one more of that kind lay in each cell.
        """
        columns = []
        overall = values.mean(dim=0)
        for cells, counts in zip(self.cells, self.counts, strict=True):
            sums = torch.zeros(len(counts), values.shape[1], device=values.device).index_add_(0, cells, values)
            others = counts[cells] - 1
            means = (sums[cells] - values + overall) / (others + 1)[:, None]
            columns += [means, torch.log1p(others)[:, None]]
        return torch.cat(columns, dim=1)


def columns(components: int) -> int:
    """How wide `around` is for so many components."""
    return len(OCCUPANCIES) * (components + 1)


def _cells(lattice: Tensor, occupancy: float) -> Tensor:
    """(N,) numbers of the cells at the first size at which they hold `occupancy` anchors on average.

    One cell where they are too few at any: cubes that double never join what lies on two sides of 0.
    """
    for shift in range(int(lattice.max() - lattice.min() + 1).bit_length() + 1):
        points, numbers, _ = Distinct.of(lattice >> shift)
        if len(lattice) >= occupancy * len(points):
            return numbers
    return torch.zeros(len(lattice), dtype=torch.long, device=lattice.device)
