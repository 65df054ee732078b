"""The scene that a file, or an early layer of one, will show, from the encoder's integers or values (SPEC §9)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.schema import Stream
from scarfmt.scene.description import Description
from scarfmt.scene.gaussians import AnchorModel, GaussianScene
from scarfmt.scene.model import Lattice


def reconstruct_gaussians(scene: QuantisedScene) -> GaussianScene:
    """The Gaussians of the last layer of an explicit file, in file order."""
    at, values, codewords = _values(scene)
    fields = scene.fields
    return explicit_scene(at, values, fields.sh_degree, scene.decoder, codewords, Description.of_header(fields))


def reconstruct_anchors(scene: QuantisedScene) -> AnchorModel:
    """The model of the last layer of an anchor file, in file order."""
    at, values, codewords = _values(scene)
    assert scene.decoder is not None
    slots = np.concatenate([content.slot_layers > 0 for content in scene.contents])
    return anchor_model(at, values, slots, scene.decoder, scene.scene_mlps, codewords)


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
        values = {curve.stream: problem.values[curve.stream][order].astype(np.float32) for curve in curves}
        return cls(problem, curves, bounds, rank[order], corners[order], placement.cell[order], values)

    def reconstruct(self, steps: Sequence[Sequence[int]], parts: Sequence[float] | None = None) -> GaussianScene:
        """About the Gaussians of a layer in which the first classes have received `steps`, values simply rounded.

        Args:
            steps: of each class that is there, those of each channel.
            parts: of each of these classes, what is there; None for all of them.
        """
        here = [self._slice(number, part) for number, part in enumerate([1.0] * len(steps) if parts is None else parts)]
        received, values = np.array(steps), {}
        for index, curve in enumerate(self.curves):
            if received[:, index].any():
                widths = cell_widths(curve.step, received[:, index]).astype(np.float32)
                values[curve.stream] = _round_slices(self.values[curve.stream], here, widths)
        at = np.concatenate([self.corners[rows] for rows in here])
        if Stream.POSITION_RESIDUAL in values:
            at += values[Stream.POSITION_RESIDUAL] * np.concatenate([self.cell[rows] for rows in here])[:, None]
        values.setdefault(Stream.SCALE, np.zeros((len(at), 3), np.float32))
        decoder = self.problem.decoder if Stream.LATENT in values else None
        nothing = None, np.zeros((len(at), 0), np.int64), np.zeros(len(at), np.int64)
        return explicit_scene(at, values, self.problem.sh_degree, decoder, nothing, self.problem.description)

    def _slice(self, number: int, part: float) -> slice:
        """Where the given part of a class is."""
        first, past = self.bounds[number : number + 2]
        return slice(first, first + int(np.searchsorted(self.rank[first:past], part)))


def _values(scene: QuantisedScene) -> tuple[F64, dict[Stream, F32], Codewords]:
    """(N, 3) positions, (N, components) of every channel, and the codewords of all anchors."""
    lattice = Lattice(scene.fields.origin, scene.fields.voxel, scene.fields.lattice_bits)
    model, contents = scene.model, scene.contents
    parts = [channel_arrays(model, content) for content in contents]
    values = {channel.stream: np.concatenate([part[channel.stream] for part in parts]) for channel in model.channels}
    places = zip(scene.tiles, contents, strict=True)
    at = [positions(lattice, tile, content.codes, residuals(model, content)) for tile, content in places]
    indices = np.concatenate([content.indices for content in contents])
    stages = model.stages(len(model.layers), np.concatenate([content.classes for content in contents]))
    return np.concatenate(at), values, (scene.codebooks, indices, stages)


def _round_slices(true: F32, slices: Sequence[slice], widths: F32) -> F32:
    """(n, components) the rows of some classes, rounded to multiples of their (classes, components) widths; 0 for 0."""
    rounded = np.empty((sum(rows.stop - rows.start for rows in slices), true.shape[1]), np.float32)
    first = 0
    for rows, width in zip(slices, widths, strict=True):
        part = rounded[first : first + rows.stop - rows.start]
        per = np.divide(1, width, out=np.zeros_like(width), where=width > 0)
        np.rint(np.multiply(true[rows], per, out=part), out=part)
        part *= width
        first += len(part)
    return rounded
