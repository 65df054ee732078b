"""Decisions for a whole scene, to be applied to each of its ranges (encoder only)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from reference_encoder.decide.allocate import ClassBounds, ranked_with_colour
from reference_encoder.decide.lattice import Root
from reference_encoder.measure.sensitivity import Sensitivity
from reference_encoder.scale.steps import RangeContent
from reference_encoder.tuning import CLASS_COLOUR_SHARE, GAUSSIAN_BITS
from scarfmt.arrays import F32, F64
from scarfmt.blocks.mlp import QuantisedMlp
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.file import HeaderFields
from scarfmt.container.schema import Stream
from scarfmt.neural.predictors import Predictor
from scarfmt.scene.codebooks import Codebooks
from scarfmt.scene.model import SceneModel


@dataclass(frozen=True)
class LatentFit:
    """The latent of view-dependent colour.

    Attributes:
        projection: (D, d) from colours beyond degree 0 to latents, lattice units.
        decoder: the network of SPEC §9.2.
        books: both codebooks.
        prices: of each stage, (classes, codewords) float32 bits, by classes of importance.
    """

    projection: F64
    decoder: QuantisedMlp
    books: Codebooks
    prices: tuple[F32, ...]

    @property
    def unit(self) -> float:
        """Length of a unit of the latent, in units of colours."""
        return float(1 / np.sqrt((self.projection[:, 0] ** 2).sum()))


@dataclass(frozen=True)
class Fit:
    """Decisions for a whole scene.

    Attributes:
        lambda_: of the last layer, squared picture error per bit.
        fields: header fields.
        model: channels, layers and classes.
        classes: of importance, before those are split of which the first layer shows a part.
        shift: :func:`reference_encoder.decide.allocate.colour_shift` of all Gaussians.
        parts: of the first classes of importance, what the first layer shows.
        root: that tiles lie in.
        tile_anchors: most anchors of a tile.
        latent: None where nothing in view-dependent colour is worth sending.
        predictors: per layer, those whose step first travels in it.
    """

    lambda_: float
    fields: HeaderFields
    model: SceneModel
    classes: ClassBounds
    shift: float
    parts: tuple[float, ...]
    root: Root
    tile_anchors: int
    latent: LatentFit | None
    predictors: Mapping[int, tuple[Predictor, ...]] = field(default_factory=dict)

    def scene(self, content: RangeContent) -> QuantisedScene:
        """A range as a file of its own would hold it."""
        latent, model = self.latent, self.model
        stages = model.max_stages > 0
        shown = stages or model.channel_index(Stream.LATENT) is not None
        return QuantisedScene(
            self.fields,
            model,
            content.tiles,
            content.contents,
            codebooks=latent.books if latent is not None and stages else None,
            decoder=latent.decoder if latent is not None and shown else None,
            predictors=self.predictors,
        )

    @property
    def box(self) -> tuple[F64, F64]:
        """Two corners of the root: where neighbours are told apart."""
        low = np.array(self.root.low)
        return low, low + self.root.side


def ranked(seen: Sensitivity, lambda_: float, shift: float, sh_degree: int) -> F64:
    """(n,) importance that makes classes of Gaussians."""
    share = CLASS_COLOUR_SHARE if sh_degree else 0.0
    return ranked_with_colour(seen.absence, seen.colour, share, lambda_ * GAUSSIAN_BITS, shift)
