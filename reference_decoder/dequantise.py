"""Exact-class reconstruction: from integers to values that every decoder must equal bit by bit (SPEC §9.1-9.2).

All arithmetic is binary64 without fused operations, and integers stay exact in it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F32, F64, I64, U64, Ints
from scarfmt.codecs.channels import REACH, in_binary32
from scarfmt.container.directory import Table, Tile
from scarfmt.container.morton import deinterleave
from scarfmt.errors import Malformed
from scarfmt.scene.codebooks import Codebooks
from scarfmt.scene.model import Lattice


def offset_values(values: Ints, step: Sequence[float]) -> F32:
    """(n, K, 3) float32 offsets of (n, K, 3) int32: binary32(binary64(v) * step) (SPEC §9.2)."""
    return in_binary32(values, np.asarray(step, np.float64))


def corners(lattice_bits: int, depth: NDArray[np.uint8], prefix: U64) -> F64:
    """(T, 3) float64 lattice coordinates of the lowest corners of T tiles; integers below 2^32 (SPEC §6.2)."""
    free = (lattice_bits - depth.astype(np.int64)).astype(np.uint64)
    return (deinterleave(prefix) << free[:, None]).astype(np.float64)


def positions(lattice: Lattice, tile: Tile, codes: U64, residuals: F64 | None) -> F64:
    """(n, 3) float64 world positions of a tile's anchors (SPEC §9.1).

    Args:
        lattice: origin, voxel and bits.
        tile: the tile.
        codes: (n,) uint64 local Morton codes.
        residuals: (n, 3) float64 position residuals in cells of 2^shift voxels, None for none.

    Raises:
        Malformed: ``value-range`` when a residual leaves -1..1: the anchor would lie outside its tile.
    """
    cell = float(1 << tile.shift)
    local = deinterleave(codes).astype(np.float64)
    depth, prefix = np.array([tile.depth], np.uint8), np.array([tile.prefix], np.uint64)
    at = (corners(lattice.bits, depth, prefix) + local * cell) + cell / 2
    if residuals is not None:
        if bool((np.abs(residuals) > REACH).any()):
            raise Malformed(
                "value-range", "a position residual is not in -1..1 cells (SPEC §9.1)", field="POSITION_RESIDUAL"
            )
        at += cell * residuals
    return np.asarray(lattice.origin, np.float64) + lattice.voxel * at


def tile_boxes(lattice: Lattice, tiles: Table) -> tuple[F64, F64]:
    """(T, 3) float64 lowest and highest world coordinates anchors of each tile can have, from the tile table alone.

    A tile's cube, and half a cell all round for residuals of up to one.

    Args:
        lattice: origin, voxel and bits.
        tiles: (T,) TILE_DTYPE.
    """
    low = corners(lattice.bits, tiles["depth"], tiles["prefix"])
    size = np.exp2(lattice.bits - tiles["depth"].astype(np.float64))[:, None]
    margin = (REACH - 0.5) * np.exp2(tiles["shift"].astype(np.float64))[:, None]
    origin = np.asarray(lattice.origin, np.float64)
    return origin + lattice.voxel * (low - margin), origin + lattice.voxel * (low + size + margin)


def latents(books: Codebooks | None, indices: Ints, stages: I64, refinements: F32 | None, dimension: int) -> F32:
    """(n, d) float32 latents: binary32(sum of codewords) + value of the latent channel, in binary32 (SPEC §9.2).

    Args:
        books: coarse and residual codewords; None where no layer so far has stages.
        indices: (n, M) codeword numbers.
        stages: (n,) stages received, 0..M.
        refinements: (n, d) values of the latent channel, None where there is none.
        dimension: d.
    """
    # Sums of codewords are integers below 2^24: exact in binary32, in any order.
    z = np.zeros((len(indices), dimension), np.float32)
    if books is not None:
        # A row of zeros after the last codeword stands for a stage that was not received.
        nothing = np.zeros((1, dimension), np.int64)
        padded = [np.vstack([book, nothing]).astype(np.float32) for book in (books.coarse, books.residual)]
        for stage in range(indices.shape[1]):
            book = padded[min(stage, 1)]
            z += book[np.where(stages > stage, indices[:, stage], len(book) - 1)]
    if refinements is not None:
        z += refinements
    return z
