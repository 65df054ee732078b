"""Data that steps of the out-of-core encoder hand to each other, and the order in which they run (nothing normative).

    step        of            hands on      does
    scan, cut   the source    Bounds, Range bounds of all positions; intervals of the Morton order
    glance      each range    Glance        rows that tell where the scene is, and few Gaussians that stand for all
    overlook    all glances   Overview      up axis, views, what is drawn in place of ranges elsewhere
    measure     each range    Measured      what each of its Gaussians weighs in pictures
    sample      each range    Sample        some of its Gaussians, with what they weigh
    pictures    some ranges   Pictures      of the source, to judge by; which ranges: `Overview.judging`
    fit         all samples   Fit           all that is decided for the whole scene, at one lambda
    judge       those ranges  Judged        errors of pictures of a range under a Fit, by which lambda is corrected
    train       some tiles    Fit           predictors, from effort 2
    apply       each range    RangeContent  tiles and all integers of the range
    histograms  each range    Histograms    how often each symbol comes under each table; and the symbols, RangeSymbols
    reduce      all of these  Models        static tables, and the model blocks of every layer
    code        each range    Segment       TILE blocks

In modules of :mod:`reference_encoder.scale`, `options` being :class:`EncodeOptions`:

    glance.glance(scene, part, bounds, options) -> Glance
    glance.overlook(glances, parts, bounds, options) -> Overview
    measured.measure(overview, part, scene) -> Measured
    sample.sample(overview, part, scene, measured) -> Sample
    judged.pictures(overview, part, scene, measured, sight) -> Pictures, `LOOP` for `settled`, `REPORT` at the end
    judged.judge(overview, fit, part, pictures) -> Judged
    judged.quality_of(overview, judged, sight) -> Quality, for METADATA
    fitted.settled(overview, samples, judge: Callable[[Fit], Sequence[Judged]]) -> Fit
    trained.some_tiles(overview, part, content) -> RangeContent
    trained.train(overview, fit, tiles: Sequence[RangeContent], anchors) -> Fit
    applied.apply(overview, fit, part, scene, measured) -> RangeContent
    coded.histograms(fit, content) -> Histograms, RangeSymbols
    coded.reduce(overview, fit, histograms, metadata) -> Models
    coded.code(models, symbols) -> Segment

Where `options.trains_networks`, histograms wait for predictors: `apply` of all ranges, `some_tiles` of each, one
`train` on all of these, then `histograms`. Contents stay as they are; only how they are coded changes. Elsewhere one
task does `apply` and `histograms`, and contents are not kept.

A step of a range is a pure function of its arguments: which process runs it, and when, changes nothing. Everything
here is made of arrays, numbers and tuples, so that it can be pickled. Memory of a step is bounded by its range.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from reference_encoder.decide.lattice import Root
from scarfmt.arrays import F32, F64, I64, U64
from scarfmt.coding.tile import TileContent
from scarfmt.coding.writer import Histogram, RecordedTile
from scarfmt.container.directory import Tile
from scarfmt.container.file import Block
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.scene.gaussians import GaussianScene


@dataclass(frozen=True)
class Bounds:
    """Result of scanning a whole scene.

    Attributes:
        low, high: of all positions, three numbers each, world units.
        count: Gaussians.
        sh_degree: of their colours, 0..3.
    """

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    count: int
    sh_degree: int

    @property
    def root(self) -> Root:
        """Corner and edge of the octree."""
        return Root.of(np.array(self.low), np.array(self.high))

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


@dataclass(frozen=True)
class Measured:
    """Weights of the n Gaussians of a range in pictures, all kinds of views together.

    Attributes:
        shape: (n,) float32 per squared relative change of the splat.
        colour: (n,) float32 per squared change of its colour.
        pixel: (n,) float32 width of a pixel at each, world units.
        largest: (n,) float32 largest blending weight in any pixel.
    """

    shape: F32
    colour: F32
    pixel: F32
    largest: F32


@dataclass(frozen=True)
class Sample:
    """Rows of one range, or of several.

    Attributes:
        scene: the Gaussians.
        measured: what they weigh.
        count: Gaussians that they stand for.
    """

    scene: GaussianScene
    measured: Measured
    count: int


@dataclass(frozen=True)
class Judged:
    """Part of a range in the errors of pictures from the judging views.

    Attributes:
        error: (V,) float64 mean squared error of the picture, peak 1, from every view; 0 where it is not seen.
        cover: (V,) float64 part of what the picture shows that the range makes up, 0..1.
    """

    error: F64
    cover: F64


@dataclass(frozen=True)
class RangeContent:
    """All integers of a range.

    Attributes:
        tiles, contents: ascending, within the range; a range of which nothing is worth sending has none.
        left_out: Gaussians that are not in the file: invisible ones, and faint ones.
        without_view_dependence: anchors with no colour beyond degree 0.
    """

    tiles: tuple[Tile, ...]
    contents: tuple[TileContent, ...]
    left_out: tuple[int, int] = (0, 0)
    without_view_dependence: int = 0


@dataclass(frozen=True)
class Histograms:
    """Symbols of a range, of one layer after the other; they add up over ranges.

    Attributes:
        layers: of each layer.
        anchors: (layers,) int64 anchors up to each layer.
        left_out: as :class:`RangeContent` has it.
        without_view_dependence: as :class:`RangeContent` has it.
    """

    layers: tuple[Histogram, ...]
    anchors: I64
    left_out: tuple[int, int] = (0, 0)
    without_view_dependence: int = 0


@dataclass(frozen=True)
class RangeSymbols:
    """All symbols of a range, to be coded once the tables of the file are known.

    Attributes:
        tiles: of the range.
        layers: of each layer, what each tile says.
    """

    tiles: tuple[Tile, ...]
    layers: tuple[tuple[RecordedTile, ...], ...]


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
class LayerSegment:
    """The TILE blocks of one layer of a range, one behind the other.

    Attributes:
        payload: their bytes.
        tiles: (m,) int64 which tile of the range each is of, ascending.
        lengths: (m,) int64 bytes of each.
        counts: (m,) int64 anchors that first appear in each.
        checksums: (m,) uint32 CRC-32 of each.
        stream_bytes: bytes of each kind of stream, FRAMING included (:class:`scarfmt.container.schema.Stream`).
    """

    payload: bytes
    tiles: I64
    lengths: I64
    counts: I64
    checksums: I64
    stream_bytes: tuple[int, ...]


@dataclass(frozen=True)
class Segment:
    """A range as the file has it.

    Attributes:
        tiles: its rows of the tile table.
        layers: of each layer, its blocks.
    """

    tiles: tuple[Tile, ...]
    layers: Sequence[LayerSegment]
