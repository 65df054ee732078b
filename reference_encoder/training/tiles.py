"""Tiles of a trained scene: cubes of its lattice, at the resolution that training had (SPEC §6.2, §6.3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from reference_encoder.decide.lattice import split, usual_tile
from scarfmt.arrays import I64, U64
from scarfmt.container.file import Tile


@dataclass(frozen=True)
class Tiles:
    """The tiles of n anchors.

    Attributes:
        tiles: tile table.
        tile: (n,) int64 tile of each anchor.
        codes: (n,) uint64 local Morton codes.
    """

    tiles: tuple[Tile, ...]
    tile: I64
    codes: U64

    @classmethod
    def of(cls, codes: U64, bits: int, most: int | None = None) -> Tiles:
        """The largest cubes that hold few enough anchors.

        Args:
            codes: (n,) uint64 Morton codes of `bits` bits an axis; n >= 1.
            most: anchors of a tile, None for what is usual.
        """
        order = np.argsort(codes, kind="stable")
        depth, prefix, first = split(codes[order], bits, most or usual_tile(len(codes)))
        tile = np.empty(len(codes), np.int64)
        tile[order] = np.repeat(np.arange(len(first)), np.diff(np.append(first, len(codes))))
        own_bits = (3 * (bits - depth)).astype(np.uint64)
        local = codes & ((np.uint64(1) << own_bits) - np.uint64(1))[tile]
        tiles = tuple(Tile(int(d), 0, int(p)) for d, p in zip(depth, prefix, strict=True))
        return cls(tiles, tile, local)

    def anchors(self, appears: I64) -> list[I64]:
        """Rows of the anchors of each tile in the order of the file; (n,) `appears`: the layer of each."""
        order = np.lexsort((self.codes, appears, self.tile))
        return np.split(order, np.cumsum(np.bincount(self.tile))[:-1])
