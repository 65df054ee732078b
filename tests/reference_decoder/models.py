"""Small anchor models."""

from __future__ import annotations

import numpy as np

from scarfmt.scene.gaussians import AnchorModel, Mlp

EYE = np.array([0.5, -2.0, 3.0])


def random_model(seed: int = 0, anchors: int = 40, slots: int = 3, features: int = 5, inputs: int = 9) -> AnchorModel:
    rng = np.random.default_rng(seed)

    def perceptron(outputs: int) -> Mlp:
        weights = rng.normal(size=(8, inputs)) / 2, rng.normal(size=(outputs, 8)) / 2
        biases = rng.normal(size=8), rng.normal(size=outputs)
        return Mlp(
            (weights[0].astype(np.float32), weights[1].astype(np.float32)),
            (biases[0].astype(np.float32), biases[1].astype(np.float32)),
        )

    mlps = {"opacity": perceptron(slots), "cov": perceptron(7 * slots), "color": perceptron(3 * slots)}
    return AnchorModel(
        rng.normal(size=(anchors, 3)),
        rng.normal(size=(anchors, features)).astype(np.float32),
        rng.normal(size=(anchors, slots, 3)).astype(np.float32),
        rng.normal(-2, 0.5, (anchors, 6)).astype(np.float32),
        mlps,
        rng.random((anchors, slots)) < 0.7,
    )
