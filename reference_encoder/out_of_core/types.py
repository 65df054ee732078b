"""Data that steps of the out-of-core encoder hand to each other, and the order in which they run (nothing normative).

    step           of            hands on      does
    scan, count    the source    Bounds, Range bounds of all positions; intervals of the Morton order
    bin            each chunk    rows          of each range in one place
    summarise      each range    two scenes    rows that tell where the scene is, and few Gaussians that stand for all
    overview       all summaries Overview      up axis, views, what is drawn in place of ranges elsewhere
    measure        each range    Weights       importance of each of its Gaussians in pictures
                                 Sample        some of its Gaussians, with their importance
    pictures       some ranges   Pictures      of the source, to judge by; which ranges: `Overview.judging`
    fit            all samples   Fit           all that is decided for the whole scene, at one lambda
    judge          those ranges  errors        of pictures of a range under a Fit, by which lambda is corrected
    apply          each range    Histograms    tiles and all integers of the range; how often each symbol comes under
                                 RangeSymbols  each table; the symbols; and where content is in tiles
    reduce         all of these  Models        static tables, and the model blocks of every layer
    code           each range    Rows          TILE blocks
    opening        all summaries blocks        where content is in all tiles; the first view, and a picture of it
    merge          all of these  the file

A step of a range is a pure function of its arguments: which process runs it, and when, changes nothing. Everything
here is made of arrays, numbers and tuples, so that it can be kept in files. Memory of a step is bounded by its range.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from reference_encoder.importance.weights import Weights
from reference_encoder.rdo.lattice import RootCube
from scarfmt.arrays import F64, I64, U8, U64
from scarfmt.coding.writer import Histogram, RecordedTile
from scarfmt.container.directory import Table, Tile
from scarfmt.container.file import Block
from scarfmt.container.schema import ENTRY_DTYPE
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.scene.description import NOTHING_SAID, Description
from scarfmt.scene.gaussians import GaussianScene


@dataclass(frozen=True)
class Bounds:
    """Result of scanning a whole scene.

    Attributes:
        low, high: of all positions, three numbers each, world units.
        count: Gaussians.
        sh_degree: of their colours, 0..3.
        description: what the source says about them.
    """

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    count: int
    sh_degree: int
    description: Description = NOTHING_SAID

    @property
    def root(self) -> RootCube:
        """Corner and edge of the octree."""
        return RootCube.around(np.array(self.low), np.array(self.high))

    def paths(self, positions: F64) -> U64:
        """(N,) uint64 Morton codes of `MAX_TILE_DEPTH` bits an axis of (N, 3) positions in the root."""
        return self.root.paths(positions)


@dataclass(frozen=True)
class Range:
    """An interval of the Morton order, which no tile reaches beyond.

    Attributes:
        number: of the range, 0.. in Morton order.
        first, past: Morton codes (:meth:`Bounds.paths`): those of its Gaussians are `first` at least and below `past`.
        count: Gaussians in it, at least 1.
    """

    number: int
    first: int
    past: int
    count: int


Sample = tuple[GaussianScene, Weights]
"""Some Gaussians of a range, of every range the same share, and what they weigh."""


@dataclass(frozen=True)
class Histograms:
    """Symbols of a range, of one layer after the other; they add up over ranges.

    Attributes:
        layers: of each layer.
        anchors: (layers,) int64 anchors up to each layer.
        losses: (3,) int64 Gaussians that are not in the file as they were: left out because they are invisible, or
            faint, and sent without colour beyond degree 0.
    """

    layers: tuple[Histogram, ...]
    anchors: I64
    losses: I64


RangeSymbols = tuple[tuple[Tile, ...], tuple[tuple[RecordedTile, ...], ...]]
"""The tiles of a range and, of each layer, the symbols of each: coded once the tables of the file are known."""


@dataclass(frozen=True)
class Models:
    """Models that all ranges are coded with.

    Attributes:
        tables: static tables in force in each layer.
        blocks: model blocks of all layers, in file order; they belong to no tile.
        anchors: (layers,) int64 anchors of the file up to each layer.
    """

    tables: tuple[Mapping[TableKey, SymbolTable], ...]
    blocks: tuple[Block, ...]
    anchors: I64


@dataclass(frozen=True)
class Rows:
    """What the directory says of a range.

    Attributes:
        tiles: its rows of the tile table.
        layers: of each layer, the bytes, as uint8, of the rows of its TILE blocks (:meth:`table`).
        stream_bytes: (layers, kinds) int64 bytes of each kind of stream, FRAMING included
            (:class:`scarfmt.container.schema.Stream`).
    """

    tiles: tuple[Tile, ...]
    layers: tuple[U8, ...]
    stream_bytes: I64

    def table(self, layer: int) -> Table:
        """The rows of TILE blocks of a layer, 0-based; tiles are numbered within the range."""
        return self.layers[layer].view(ENTRY_DTYPE)
