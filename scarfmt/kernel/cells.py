"""Compiled sums over cells, and fine values (SPEC §10.2)."""

from __future__ import annotations

import ctypes
import itertools
from collections.abc import Sequence

import numpy as np

from scarfmt.arrays import F64, I32, I64, U64, Ints, Numbers
from scarfmt.kernel.memory import address
from scarfmt.kernel.scratch import SCRATCH
from scarfmt.kernel.structs import DEPTHS, Cells
from scarfmt.limits import MAX_LOCAL_BITS
from scarfmt.neural.layer_context import LayerContext


class CellNames:
    """In which cells the anchors of a tile-layer lie, as the library reads it.

    Args:
        cell: per depth, coarse first, the (n,) int32 cell of each anchor or row, in one piece.
        sizes: per depth, how many cells there are.
    """

    def __init__(self, cell: Sequence[I32], sizes: Sequence[int]) -> None:
        pointers = ctypes.c_void_p * DEPTHS
        self.depths, self.sizes = len(cell), tuple(sizes)
        self._cell = cell
        self._pointers = pointers(*(address(array, np.int32) for array in cell))
        self._sizes = (ctypes.c_int64 * DEPTHS)(*sizes)

    @classmethod
    def of(cls, library: ctypes.CDLL, codes: U64, by_code: I64, bits: int, occupancies: Sequence[int]) -> CellNames:
        """The cells of SPEC §10.2.

        Args:
            codes: (n,) uint64 Morton codes below 8^bits, bits 0..21.
            by_code: (n,) int64 anchors by (code, index).
            occupancies: targets, coarse first.
        """
        count, depths = len(codes), len(occupancies)
        if len(by_code) != count or not 0 <= bits <= MAX_LOCAL_BITS or depths > DEPTHS:
            raise TypeError(f"{len(by_code)} of {count} anchors, {bits} bits, {depths} depths")
        cell, sizes = np.empty((depths, count), np.int32), np.zeros(depths, np.int64)
        targets = (ctypes.c_int64 * DEPTHS)(*occupancies)
        rows = (ctypes.c_void_p * DEPTHS)(*(row.ctypes.data for row in cell))
        arrays = address(codes, np.uint64), address(by_code, np.int64)
        library.scar_cells_names(*arrays, count, bits, targets, depths, rows, sizes.ctypes.data)
        return cls(list(cell), sizes.tolist())

    def struct(self, columns: int, sums: Sequence[int]) -> Cells:
        """Cells of `columns` values each, with (size, columns + 1) float64 at the addresses `sums`."""
        return Cells(self.depths, columns, self._pointers, (ctypes.c_void_p * DEPTHS)(*sums), self._sizes)

    def scratch(self, columns: int) -> Cells:
        """Cells with anything in them, for one call that empties them first."""
        struct = self.struct(columns, _side_by_side("sums", [8 * size * (columns + 1) for size in self.sizes]))
        words = words_of_rows(columns + 1)
        struct.means[: self.depths] = _side_by_side("cell means", [4 * size * words for size in self.sizes])
        return struct


def _side_by_side(name: str, sizes: Sequence[int]) -> list[int]:
    """Addresses in scratch memory of blocks of these sizes."""
    ends = list(itertools.accumulate(sizes, initial=0))
    start = SCRATCH.at(name, ends[-1])
    return [start + end for end in ends[:-1]]


def words_of_rows(words: int) -> int:
    """Rows are filled up to be read by four words."""
    return -(-words // 4) * 4


def cell_names(context: LayerContext, library: ctypes.CDLL) -> CellNames:
    """The cells of the anchors of a tile-layer; to be kept with it."""
    return CellNames.of(library, context.codes, context.by_code, context.frame.bits, context.model.context.occupancies)


class KernelCellSums:
    """Sums per cell and depth over the anchors added so far.

    Args:
        library: the compiled library.
        cell: per depth, coarse first, the (n,) int32 cell of each anchor or row, in one piece.
        sizes: per depth, how many cells there are.
        columns: values of an anchor.
    """

    def __init__(self, library: ctypes.CDLL, cell: Sequence[I32], sizes: Sequence[int], columns: int) -> None:
        self.functions, self._depths, self._columns = library, len(cell), columns
        self._sums = [np.zeros((size, columns + 1)) for size in sizes]
        self._names = CellNames(cell, sizes)
        self.struct = self._names.struct(columns, [array.ctypes.data for array in self._sums])

    def add(self, anchors: Ints, values: Numbers) -> None:
        """Add (m,) anchors with their (m, columns) integer values."""
        places, numbers = np.ascontiguousarray(anchors, np.int64), np.ascontiguousarray(values, np.float64)
        address = ctypes.byref(self.struct)
        self.functions.scar_cells_add(address, places.ctypes.data, len(places), numbers.ctypes.data)

    def around(self, anchors: Ints) -> tuple[F64, F64]:
        """(w, depths, columns) means and (w, depths) counts in the cells of (w,) anchors."""
        places = np.ascontiguousarray(anchors, np.int64)
        means = np.empty((len(places), self._depths, self._columns))
        counts = np.empty((len(places), self._depths))
        address = ctypes.byref(self.struct)
        arrays = (array.ctypes.data for array in (means, counts))
        self.functions.scar_cells_around(address, places.ctypes.data, len(places), *arrays)
        return means, counts


def kernel_fine(library: ctypes.CDLL, values: Ints, steps: Ints, out: I32) -> None:
    """Put the fine values of (n, components) `values`, |v| < 2^31, at (n,) `steps`, into `out`, (n, components)."""
    short, counts = np.ascontiguousarray(values, np.int32), np.ascontiguousarray(steps, np.int64)
    if out.shape != short.shape or out.dtype != np.int32 or (out.size and out.strides[1] != 4):
        raise TypeError(f"{out.dtype} of shape {out.shape}, strides {out.strides} for {short.shape} fine values")
    stride = out.strides[0] // 4
    library.scar_fine(short.ctypes.data, counts.ctypes.data, *short.shape, stride, out.ctypes.data)
