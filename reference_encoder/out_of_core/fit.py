"""Decisions for a whole scene, and all integers of one range as they say (encoder only)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from reference_encoder.importance.attributes import Attributes, visible_attributes
from reference_encoder.importance.sensitivity import (
    Sensitivity,
    estimate_absence,
    estimate_colour,
    measure_sensitivity,
)
from reference_encoder.importance.weights import Weights
from reference_encoder.out_of_core.overview import Overview
from reference_encoder.out_of_core.types import Range
from reference_encoder.profiles.explicit import choose_step, gaussian_channels, log_extent, view_dependent
from reference_encoder.rdo.allocation import cut_contents, quantise_channel
from reference_encoder.rdo.classes import ClassBounds, Classes, rank_by_coverage, rank_with_colour
from reference_encoder.rdo.latent import Latent
from reference_encoder.rdo.lattice import RootCube, place
from reference_encoder.tuning import CLASS_COLOUR_SHARE, GAUSSIAN_BITS, INVISIBLE_WEIGHT, REST_SHARE
from scarfmt.arrays import F64, I64
from scarfmt.blocks.mlp import QuantisedMlp
from scarfmt.coding.tile import TileContent
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.directory import Tile
from scarfmt.container.file import HeaderFields
from scarfmt.container.schema import Stream
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.scene.model import SceneModel


@dataclass(frozen=True)
class LatentFit:
    """The latent of view-dependent colour.

    Attributes:
        projection: (D, d) from colours beyond degree 0 to latents, lattice units.
        decoder: the network of SPEC §9.2.
    """

    projection: F64
    decoder: QuantisedMlp

    def of(self, attributes: Attributes, seen: Sensitivity) -> Latent:
        """The latents of some Gaussians, in the basis of the whole scene."""
        values = (attributes.rest @ self.projection).astype(np.float32)
        # Length of a unit of the latent, in units of colours.
        unit = float(1 / np.sqrt((self.projection[:, 0] ** 2).sum()))
        return Latent(values, seen.colour * REST_SHARE * unit**2, self.decoder, self.projection)


@dataclass(frozen=True)
class Fit:
    """Decisions for a whole scene.

    Attributes:
        lambda_: of the last layer, squared picture error per bit.
        fields: header fields.
        model: channels, layers and classes.
        classes: of importance, before those are split of which the first layer shows a part.
        shift: :func:`reference_encoder.rdo.classes.measure_colour_shift` of all Gaussians.
        parts: of the first classes of importance, what the first layer shows.
        root: that tiles lie in.
        tile_anchors: most anchors of a tile.
        latent: None where nothing in view-dependent colour is worth sending.
    """

    lambda_: float
    fields: HeaderFields
    model: SceneModel
    classes: ClassBounds
    shift: float
    parts: tuple[float, ...]
    root: RootCube
    tile_anchors: int
    latent: LatentFit | None

    def scene(self, tiles: tuple[Tile, ...], contents: tuple[TileContent, ...]) -> QuantisedScene:
        """A range as a file of its own would hold it."""
        shown = self.model.channel_index(Stream.LATENT) is not None
        decoder = self.latent.decoder if shown and self.latent is not None else None
        return QuantisedScene(self.fields, self.model, tiles, contents, decoder=decoder)


def rank_gaussians(measured: Weights, lambda_: float, shift: float, sh_degree: int) -> F64:
    """(n,) importance that makes classes of Gaussians."""
    share, absence = CLASS_COLOUR_SHARE if sh_degree else 0.0, estimate_absence(measured)
    return rank_with_colour(absence, estimate_colour(measured), share, lambda_ * GAUSSIAN_BITS, shift)


def apply(
    overview: Overview, fit: Fit, part: Range, scene: GaussianScene, measured: Weights
) -> tuple[QuantisedScene, I64]:
    """Tiles and all integers of a range, and its losses (:class:`Histograms`).

    Returns:
        A range of which nothing is worth sending has no tiles.
    """
    every = fit.classes.classify(rank_gaussians(measured, fit.lambda_, fit.shift, overview.bounds.sh_degree))
    left_out, invisible = every < 0, measured.largest < INVISIBLE_WEIGHT
    gone = int((left_out & invisible).sum()), int((left_out & ~invisible).sum())
    chosen = np.flatnonzero(every >= 0)
    if not len(chosen):
        return fit.scene((), ()), np.array([*gone, 0])
    measured = measured.take(chosen)
    attributes = visible_attributes(scene.take(chosen), measured.pixel)
    seen = measure_sensitivity(attributes, measured)
    wanted = choose_step(seen, fit.lambda_)
    within, bits = (part.first, part.past), fit.fields.lattice_bits
    placement = place(attributes.positions, wanted, fit.tile_anchors, fit.root, bits, within)
    classes, model = split_classes(fit, every[chosen], attributes), fit.model
    latent = None if fit.latent is None else fit.latent.of(attributes, seen)
    values, weights, _ = gaussian_channels(attributes, seen, placement, latent)
    integers = {}
    for index, channel in enumerate(model.channels):
        stream, steps = channel.stream, np.array([row[index] for row in model.layers[-1].steps])
        received = channel.first_width, steps
        integers[stream] = quantise_channel(values[stream], weights[stream], classes, received, fit.lambda_)
    whole = fit.scene(placement.tiles, cut_contents(model, placement, classes, integers))
    return whole, np.array([*gone, int((~view_dependent(whole))[classes].sum())])


def split_classes(fit: Fit, importance: I64, attributes: Attributes) -> I64:
    """(n,) classes as the file has them, of Gaussians of these classes of importance."""
    none, low = np.zeros(fit.classes.count), np.array(fit.root.low)
    box = low, low + fit.root.side
    return (
        Classes(
            of=importance,
            count=fit.classes.count,
            importance=none,
            coverage_rank=rank_by_coverage(attributes.positions, importance, log_extent(attributes), box),
            presence_bits=lambda _: none,
        )
        .split(fit.parts)
        .of
    )
