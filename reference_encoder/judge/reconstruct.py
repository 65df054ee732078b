"""The scene that a file, or an early layer of one, will show, from the encoder's integers or values (SPEC §9)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from reference_decoder.reconstruct import (
    Codewords,
    anchor_model,
    channel_arrays,
    explicit_scene,
    positions,
    residuals,
)
from reference_encoder.rdo.curves import RdCurve
from reference_encoder.rdo.rdo_input import RdoInput
from scarfmt.arrays import F32, F64, I64
from scarfmt.codecs.channels import cell_widths
from scarfmt.coding.tile import TileContent
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.directory import Tile
from scarfmt.container.schema import Stream
from scarfmt.scene.description import Description
from scarfmt.scene.gaussians import AnchorModel, GaussianScene, allocate_scene
from scarfmt.scene.model import Lattice

_ROWS = 16384
"""Anchors of a class at a time."""


def reconstruct_gaussians(scene: QuantisedScene) -> GaussianScene:
    """The Gaussians of the last layer of an explicit file, in file order."""
    described, degree = Description.of_header(scene.fields), scene.fields.sh_degree

    def tile_scene(tile: Tile, content: TileContent) -> GaussianScene:
        at, values, codewords = _tile_values(scene, tile, content)
        return explicit_scene(at, values, degree, scene.decoder, codewords, described)

    room = allocate_scene(sum(map(len, scene.contents)), degree, described)
    return _join(room, map(tile_scene, scene.tiles, scene.contents))


def reconstruct_anchors(scene: QuantisedScene) -> AnchorModel:
    """The model of the last layer of an anchor file, in file order."""
    assert scene.decoder is not None
    tiles = zip(scene.tiles, scene.contents, strict=True)
    at, values, codewords = zip(*(_tile_values(scene, tile, content) for tile, content in tiles), strict=True)
    channels = {stream: np.concatenate([each[stream] for each in values]) for stream in values[0]}
    indices, stages = (np.concatenate([each[part] for each in codewords]) for part in (1, 2))
    slots = np.concatenate([content.slot_layers > 0 for content in scene.contents])
    chosen = scene.codebooks, indices, stages
    return anchor_model(np.concatenate(at), channels, slots, scene.decoder, scene.scene_mlps, chosen)


@dataclass(frozen=True)
class PreviewScene:
    """N anchors in the order in which layers show them: class by class, those that cover most first.

    What any layer shows of a class is then a slice, and rounding it many times takes no search.

    Attributes:
        problem: what there is to decide.
        curves: first steps of all channels.
        bounds: (classes + 1,) where classes begin.
        rank: (N,) of each anchor in its class, 0 to below 1.
        corners: (N, 3) float64 positions less their residuals.
        cell: (N,) float64 width of its cell, world units.
        values: (N, components) float32 per channel.
    """

    problem: RdoInput
    curves: Sequence[RdCurve]
    bounds: I64
    rank: F64
    corners: F64
    cell: F64
    values: Mapping[Stream, F32]

    @classmethod
    def of(cls, problem: RdoInput, curves: Sequence[RdCurve]) -> PreviewScene:
        """All anchors of a problem."""
        classes, placement = problem.classes, problem.placement
        rank = np.zeros(len(classes.of)) if classes.coverage_rank is None else classes.coverage_rank
        order = np.lexsort((rank, classes.of))
        bounds = np.searchsorted(classes.of[order], np.arange(classes.count + 1))
        corners = problem.positions - placement.residual * placement.cell[:, None]
        values = {curve.stream: problem.values[curve.stream].astype(np.float32)[order] for curve in curves}
        return cls(problem, curves, bounds, rank[order], corners[order], placement.cell[order], values)

    def reconstruct(self, steps: Sequence[Sequence[int]], parts: Sequence[float] | None = None) -> GaussianScene:
        """About the Gaussians of a layer in which the first classes have received `steps`, values simply rounded.

        Args:
            steps: of each class that is there, those of each channel.
            parts: of each of these classes, what is there; None for all of them.
        """
        here = []
        for number, part in enumerate([1.0] * len(steps) if parts is None else parts):
            first, past = self.bounds[number : number + 2]
            here.append(slice(first, first + int(np.searchsorted(self.rank[first:past], part))))
        total = sum(rows.stop - rows.start for rows in here)
        drawn = (
            self._rows(received, slice(start, min(start + _ROWS, rows.stop)))
            for received, rows in zip(np.array(steps), here, strict=True)
            for start in range(rows.start, rows.stop, _ROWS)
        )
        return _join(allocate_scene(total, self.problem.sh_degree, self.problem.description), drawn)

    def _rows(self, received: I64, rows: slice) -> GaussianScene:
        """Some anchors of a class that has received so many steps of each channel, values simply rounded."""
        values = {Stream.SCALE: np.zeros((rows.stop - rows.start, 3), np.float32)}
        for curve, steps in zip(self.curves, received, strict=True):
            if steps:
                width = cell_widths(curve.step, steps).astype(np.float32)
                values[curve.stream] = np.rint(self.values[curve.stream][rows] * (1 / width)) * width
        at = self.corners[rows]
        if Stream.POSITION_RESIDUAL in values:
            at = at + values[Stream.POSITION_RESIDUAL] * self.cell[rows, None]
        decoder = self.problem.latent.decoder if self.problem.latent and Stream.LATENT in values else None
        nothing = None, np.zeros((len(at), 0), np.int64), np.zeros(len(at), np.int64)
        return explicit_scene(at, values, self.problem.sh_degree, decoder, nothing, self.problem.description)


def _join(room: GaussianScene, parts: Iterable[GaussianScene]) -> GaussianScene:
    """`room`, filled with the Gaussians of the parts: only one of these is held at a time."""
    first = 0
    for part in parts:
        room.rows(slice(first, first + len(part))).assign(part)
        first += len(part)
        del part  # before the next is made
    return room


def _tile_values(scene: QuantisedScene, tile: Tile, content: TileContent) -> tuple[F64, dict[Stream, F32], Codewords]:
    """(n, 3) positions, (n, components) of every channel, and the codewords of a tile's anchors."""
    lattice = Lattice(scene.fields.origin, scene.fields.voxel, scene.fields.lattice_bits)
    at = positions(lattice, tile, content.codes, residuals(scene.model, content))
    stages = scene.model.stages(len(scene.model.layers), content.classes)
    return at, channel_arrays(scene.model, content), (scene.codebooks, content.indices, stages)
