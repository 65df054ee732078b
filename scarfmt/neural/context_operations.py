"""The operations on decoded context that an engine may do in its own way, and their definition (SPEC §10.2, §10.6)."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from scarfmt.arrays import I16, I32, I64, Ints
from scarfmt.neural.context import CellMeans, CellSums, Sums, put_fine
from scarfmt.neural.grid import HashGrid


class ContextOperations(Protocol):
    """The operations that compute decoded context. Every implementation gives the same integers."""

    def put_fine(self, values: Ints, steps: Ints, out: I32) -> None:
        """Put fine values into `out`: arguments as of :func:`scarfmt.neural.context.put_fine`."""

    def cell_sums(self, cells: CellMeans, columns: int) -> Sums:
        """Sums over `cells`, of no anchors yet, `columns` values each."""

    def grid_features(self, grid: HashGrid, positions: Ints) -> I16:
        """(n, width) int16 features of anchors at (n, 3) lattice `positions`, as :meth:`HashGrid.features` has them."""


class NumpyContext:
    """The operations as SPEC defines them, in NumPy."""

    def put_fine(self, values: Ints, steps: Ints, out: I32) -> None:
        put_fine(values, steps, out)

    def cell_sums(self, cells: CellMeans, columns: int) -> Sums:
        return CellSums(cells, columns)

    def grid_features(self, grid: HashGrid, positions: Ints) -> I16:
        return grid.features(positions)


NUMPY_CONTEXT = NumpyContext()


def fine(values: Ints, steps: Ints, operations: ContextOperations = NUMPY_CONTEXT) -> I64:
    """(n, components) int64 fine values (SPEC §10.2); arguments as of :func:`scarfmt.neural.context.put_fine`."""
    out = np.empty(values.shape, np.int32)
    operations.put_fine(values, steps, out)
    return out.astype(np.int64)
