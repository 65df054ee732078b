"""The meaning of presets: widths, quantiser and curriculum, also in combinations that only ablations use."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from reference_encoder.training.quantiser import Quantiser
from reference_encoder.training.vectors import Vectors


@dataclass(frozen=True)
class Recipe:
    """The settings of training that are not options of the user.

    Attributes:
        features: D, of anchors; as many hidden units.
        stages, codewords, dimension: of the quantiser of features; 0 stages: latents number by number.
        curriculum: by name.
        estimator, projector: of the quantiser.
        wander: how far the place from where networks look wanders about the camera while they learn: its standard
            deviation, in distances between cameras. What holds at one place alone shows nowhere else.
    """

    features: int = 32
    stages: int = 0
    codewords: int = 1024
    dimension: int = 16
    curriculum: str = "default"
    estimator: str = "rotation"
    projector: str = "linear"
    wander: float = 0.28

    def vectors(self, layers: int, seed: int, device: torch.device) -> Vectors | None:
        """The quantiser of a run on a device."""
        if not self.stages:
            return None
        quantiser = Quantiser(
            self.dimension,
            self.features,
            self.stages,
            self.codewords,
            estimator=self.estimator,
            projector=self.projector,
            seed=seed,
        )
        by_layer = tuple(max(1, round((layer + 1) * self.stages / layers)) for layer in range(layers))
        return Vectors(quantiser.to(device), by_layer, priced=self.curriculum != "paper")


RECIPES = {
    "default": Recipe(),
    "rvq": Recipe(stages=4),
    "paper": Recipe(features=50, stages=4, curriculum="paper", projector="paper", wander=0.0),
}
"""By preset: "rvq" is the paper's quantiser under the curriculum of "default"."""
