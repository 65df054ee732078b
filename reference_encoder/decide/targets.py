"""The targets of codewords: the latents of a scene, kept beside the quantised scene (encoder side).

Indices and LATENT values can then be chosen again when something better than static prices is known, and what
that does to the picture can be told in the encoder's own currency.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from reference_encoder.decide.rdo import choose_values
from scarfmt.arrays import F32, F64, I64
from scarfmt.codecs.channels import cell_widths
from scarfmt.coding.tile import TileContent, first_values
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.schema import Stream
from scarfmt.scene.model import SceneModel


@dataclass(frozen=True)
class Targets:
    """Latents of all anchors, in the order of the contents of all tiles, tile after tile.

    That order depends on places and classes alone, so it outlives every change of indices and codebooks' order.

    Attributes:
        latents: (N, d) float32 in units of the codeword lattice.
        weight: (N,) float32 squared picture error per squared lattice unit.
        lambda_: of the last layer, squared picture error per bit.
    """

    latents: F32
    weight: F32
    lambda_: float

    def take(self, part: slice) -> Targets:
        """The targets of some anchors."""
        return Targets(self.latents[part], self.weight[part], self.lambda_)

    def error(self, scene: QuantisedScene) -> float:
        """Squared picture error of the latents that the last layer of `scene` gives."""
        left = self.left(scene)
        unit = latent_units(scene.model, joined_classes(scene))
        index = scene.model.channel_index(Stream.LATENT)
        if unit is not None and index is not None:
            left = left - unit * np.concatenate([content.values[index] for content in scene.contents])
        return float((self.weight.astype(np.float64) @ (left * left)).sum())

    def cost(self, scene: QuantisedScene, size: float) -> float:
        """J = D + lambda * bits of a file of `size` bytes, but for errors that do not depend on the latents."""
        return self.error(scene) + self.lambda_ * 8 * size

    def left(self, scene: QuantisedScene) -> F64:
        """(N, d) what the codewords of the last layer leave to the LATENT channel."""
        latents = self.latents.astype(np.float64)
        if scene.codebooks is None:
            return latents
        received = scene.model.stages(len(scene.model.layers), joined_classes(scene))
        indices = np.concatenate([content.indices for content in scene.contents])
        return latents - scene.codebooks.latents(indices, received)

    def refined(self, scene: QuantisedScene) -> QuantisedScene:
        """The scene with a LATENT channel, if it has one, for what its codewords leave."""
        classes, index = joined_classes(scene), scene.model.channel_index(Stream.LATENT)
        unit = latent_units(scene.model, classes)
        if unit is None or index is None:
            return scene
        there = np.flatnonzero(unit[:, 0] > 0)
        values = np.zeros(unit.shape, np.int64)
        weight = self.weight[there, None].astype(np.float64) * unit[there] ** 2
        values[there] = choose_values(self.left(scene)[there] / unit[there], weight, classes[there], self.lambda_)
        edges = np.cumsum([len(content) for content in scene.contents])[:-1]
        parts = np.split(values.astype(np.int32), edges)
        contents = (_with_values(scene.model, *pair, index) for pair in zip(scene.contents, parts, strict=True))
        return replace(scene, contents=tuple(contents))


def joined_classes(scene: QuantisedScene) -> I64:
    """(N,) classes of all anchors, tile after tile."""
    return np.concatenate([content.classes for content in scene.contents])


def latent_units(model: SceneModel, classes: I64) -> F64 | None:
    """(n, d) lattice units in one LATENT unit of the last layer, 0 where a class gets none; None without LATENT."""
    index = model.channel_index(Stream.LATENT)
    if index is None:
        return None
    return cell_widths(model.channels[index].first_width, model.steps(len(model.layers), index, classes))


def refinement_bits(scene: QuantisedScene) -> float:
    """About what the LATENT channel takes: entropies of its last values in every class, tables not counted."""
    index, classes = scene.model.channel_index(Stream.LATENT), joined_classes(scene)
    if index is None:
        return 0.0
    values = np.concatenate([content.values[index] for content in scene.contents])
    bits = 0.0
    for klass in np.unique(classes):
        for column in values[classes == klass].T:
            counts = np.unique(column, return_counts=True)[1]
            bits += float((counts * np.log2(len(column) / counts)).sum())
    return bits


def _with_values(model: SceneModel, content: TileContent, values: NDArray[np.int32], index: int) -> TileContent:
    changed = replace(content, values=[*content.values[:index], values, *content.values[index + 1 :]])
    changed.first = first_values(model, changed)
    return changed
