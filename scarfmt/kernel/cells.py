"""Compiled sums over cells, and fine values (SPEC §10.2)."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.kernel.interface import DEPTHS, Cells, address

I32 = NDArray[np.int32]
I64 = NDArray[np.int64]
Ints = NDArray[np.integer[Any]]
Numbers = NDArray[np.integer[Any] | np.floating[Any]]
F64 = NDArray[np.float64]


class KernelCellSums:
    """Sums per cell and depth over the anchors added so far.

    Args:
        library: from :func:`scarfmt.kernel.functions`.
        cell: per depth, coarse first, the (n,) int32 cell of each anchor or row, in one piece.
        sizes: per depth, how many cells there are.
        columns: values of an anchor.
    """

    def __init__(self, library: ctypes.CDLL, cell: Sequence[I32], sizes: Sequence[int], columns: int) -> None:
        self.functions, self._cell, self._columns = library, cell, columns
        self._sums = [np.zeros((size, columns + 1)) for size in sizes]
        pointers = ctypes.c_void_p * DEPTHS
        self.struct = Cells(
            len(cell),
            columns,
            pointers(*(address(array, np.int32) for array in cell)),
            pointers(*(array.ctypes.data for array in self._sums)),
        )

    def add(self, anchors: Ints, values: Numbers) -> None:
        """Add (m,) anchors with their (m, columns) integer values."""
        places, numbers = np.ascontiguousarray(anchors, np.int64), np.ascontiguousarray(values, np.int64)
        address = ctypes.byref(self.struct)
        self.functions.scar_cells_add(address, places.ctypes.data, len(places), numbers.ctypes.data)

    def around(self, anchors: Ints) -> tuple[F64, F64]:
        """(w, depths, columns) means and (w, depths) counts in the cells of (w,) anchors."""
        places = np.ascontiguousarray(anchors, np.int64)
        depths = len(self._cell)
        means, counts = np.empty((len(places), depths, self._columns)), np.empty((len(places), depths))
        address = ctypes.byref(self.struct)
        arrays = (array.ctypes.data for array in (means, counts))
        self.functions.scar_cells_around(address, places.ctypes.data, len(places), *arrays)
        return means, counts


def kernel_fine(library: ctypes.CDLL, values: Ints, steps: Ints) -> I64:
    """(n, components) int64 fine values of (n, components) `values`, |v| < 2^31, at (n,) `steps`."""
    short, counts = np.ascontiguousarray(values, np.int32), np.ascontiguousarray(steps, np.int64)
    out = np.empty(short.shape, np.int64)
    library.scar_fine(short.ctypes.data, counts.ctypes.data, *short.shape, out.ctypes.data)
    return out
