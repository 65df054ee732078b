"""Compiled inputs of the index network, and the features of its hash grid (SPEC §10.5, §10.6)."""

from __future__ import annotations

import ctypes

import numpy as np

from scarfmt.arrays import F32, I16, I32, I64, Ints
from scarfmt.codecs.neural_indices import Around, IndexCoder
from scarfmt.kernel.cells import KernelCellSums
from scarfmt.kernel.memory import address
from scarfmt.kernel.structs import Embedding, Grid, GridLevel
from scarfmt.neural.grid import HashGrid
from scarfmt.neural.network import IndexNetwork


def packed_grid(grid: HashGrid) -> Grid:
    """A grid as the library reads it; to be kept with the grid, whose bits it points to."""
    levels = (GridLevel * len(grid.levels))()
    for out, level, bits in zip(levels, grid.levels, grid.bits, strict=True):
        out.dims, out.resolution, out.table_log2 = len(level.axes), level.resolution, level.table_log2
        out.axes[: len(level.axes)] = level.axes
        out.features, out.dense, out.bits = level.features, level.dense, address(bits, np.uint8)
    return Grid(len(levels), grid.origin, grid.extent_bits, grid.width, levels)


def grid_features(library: ctypes.CDLL, grid: HashGrid, positions: Ints) -> I16:
    """(n, width) int16 features of anchors at (n, 3) lattice `positions`."""
    places = np.ascontiguousarray(positions, np.int64)
    found = np.empty((len(places), grid.width), np.int16)
    library.scar_grid(ctypes.byref(grid.kept(packed_grid)), places.ctypes.data, len(places), found.ctypes.data)
    return found


def kernel_embedding_inputs(
    network: IndexNetwork,
    cells: KernelCellSums,
    classes: I64,
    settled: I32,
    features: I16,
    chosen: tuple[I64, I64],
) -> F32:
    """(m, width) float32 integers: the input columns of m anchors.

    Args:
        classes, settled, features: of all anchors: (n,) int64, (n, A) int32 and (n, grid) int16.
        chosen: (m,) numbers of the anchors, and their rows in `cells`.
    """
    inputs = network.inputs
    types = (np.int64, np.int32, np.int16, np.int64, np.int64)
    given = zip((classes, settled, features, *chosen), types, strict=True)
    arrays = [np.ascontiguousarray(array, dtype) for array, dtype in given]
    kinds, fine, grid, anchors, rows = (array.ctypes.data for array in arrays)
    shape = (inputs.classes, inputs.own, inputs.attributes, inputs.latents, inputs.latent_shift, inputs.grid)
    struct = Embedding(*shape, network.amax, kinds, fine, grid)
    out = np.empty((len(arrays[3]), inputs.width), np.float32)
    pointers = ctypes.byref(struct), ctypes.byref(cells.struct)
    cells.functions.scar_embedding_inputs(*pointers, anchors, rows, len(out), out.ctypes.data)
    return out


def embedding_inputs(coder: IndexCoder, known: Around, part: I64) -> F32:
    """The version of :func:`scarfmt.codecs.neural_indices.embedding_inputs` for cell sums that the library computed."""
    assert isinstance(known.means, KernelCellSums)
    context, chosen = known.context, (part, known.context.rows(part))
    return kernel_embedding_inputs(coder.network, known.means, context.classes, known.settled, known.grid, chosen)
