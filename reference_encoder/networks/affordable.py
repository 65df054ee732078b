"""The widest index network that a decoder can be asked for, known before any is trained (encoder side)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from reference_encoder.networks.clusters import arrange
from reference_encoder.networks.dataset import ContextOptions, IndexRows
from reference_encoder.networks.decode_time import class_counts, index_network_ns
from reference_encoder.networks.defaults import narrower, shape_for
from reference_encoder.networks.export import export
from reference_encoder.networks.grid import wave_grid
from reference_encoder.networks.shape import NetworkShape
from reference_encoder.networks.train import build
from reference_encoder.networks.view import NetworkView
from reference_encoder.options import EncodeOptions
from reference_encoder.tuning import CONTEXT_LATENTS, MOST_INDEX_SHARE
from scarfmt.coding.writer import QuantisedScene
from scarfmt.neural.grid import GridBox
from scarfmt.neural.network import IndexNetwork
from scarfmt.scene.codebooks import Codebooks


def most_index_ns(index_bits: float, options: EncodeOptions) -> float:
    """Nanoseconds of decoding that an index network can be worth at most, given what indices take without one."""
    worth = MOST_INDEX_SHARE * index_bits
    return worth / options.bits_per_ns if options.bits_per_ns else math.inf


def seen_by(scene: QuantisedScene, books: Codebooks) -> ContextOptions:
    """The inputs of an index network of a scene around an anchor."""
    context = scene.model.context
    return ContextOptions(context.passes_log2, context.occupancies, latents=min(CONTEXT_LATENTS, books.dimension))


@dataclass(frozen=True)
class Bounds:
    """Bounds of the work that a decoder may be asked for.

    Attributes:
        scene: whose layers say where indices are coded by the network.
        books: of the scene.
        multiply_adds: of an anchor, at most.
        most_ns: that all of them may take.
    """

    scene: QuantisedScene
    books: Codebooks
    multiply_adds: float
    most_ns: float

    def widest(self, attention: bool) -> NetworkShape | None:
        """The widest network that is worth trying and keeps to the bounds; None if none does."""
        return next((shape for shape in self._shapes(attention) if self._keeps(shape)), None)

    def _shapes(self, attention: bool) -> Iterator[NetworkShape]:
        """Networks worth trying, the widest first."""
        counts = class_counts(self.scene.contents)
        stages = self.scene.model.layers[-1].stages
        shape: NetworkShape | None = shape_for(int(counts[: len(stages)] @ stages), self.books.dimension, attention)
        while shape is not None:
            yield shape
            shape = narrower(shape)

    def _keeps(self, shape: NetworkShape) -> bool:
        if math.isinf(self.multiply_adds) and math.isinf(self.most_ns):
            return True
        network, model = self.untrained(shape), self.scene.model
        if network.multiply_adds(model.max_stages) > self.multiply_adds:
            return False
        return index_network_ns(replace(self.scene, network=network)) <= self.most_ns

    def untrained(self, shape: NetworkShape) -> IndexNetwork:
        """A network of a shape that has seen one row of zeros: only its size counts."""
        unused = tuple(np.zeros(size, np.int64) for size in self.books.sizes)
        books, (coarse, residual) = arrange(self.books, (unused[0], unused[1]))
        model, none = self.scene.model, np.zeros(1, np.int64)
        columns = NetworkView(seen_by(self.scene, books), wave_grid(GridBox((0, 0, 0), 0))).columns(model)
        inputs, codes = np.zeros((1, columns.width), np.int16), np.zeros((1, model.max_stages), np.int16)
        rows = IndexRows(inputs, none, none, none, codes, np.zeros((1, 2), np.int64), 1, 1)
        return export(build(rows, books, (coarse.sizes, residual.sizes), shape, 0), columns, books)
