"""How large an index network a scene can pay for, and how long to train it: as measured on real scenes.

A network costs its bytes once and saves a share of every index, so the best width grows about with the square root
of the number of indices: from 8 for 75 thousand to 32 for a million.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from reference_encoder.networks.model import NetworkShape
from reference_encoder.networks.train import TrainOptions

LATENTS = 16
"""Latent dimensions whose cell means are inputs."""

_NARROWEST, _WIDEST = 6, 64
_INDICES_OF_EIGHT = 75_000
_CODEWORD_DIMS = 24
_FINE_WEIGHTS_FROM = 20
_SMALLEST_BATCH, _LARGEST_BATCH = 64, 1024
_RATE = 0.018


@dataclass(frozen=True)
class TrainingBudget:
    """What an effort level may spend.

    Attributes:
        rows: most rows in the training sample. Many rows seen twice beat few seen often: what codewords of their own
            learn from a sample does not hold for the rest of the scene.
        visits: rows seen in all epochs together.
        most_epochs: of a small scene.
    """

    rows: int
    visits: int
    most_epochs: int


BUDGETS = {
    1: TrainingBudget(200_000, 400_000, 16),
    2: TrainingBudget(500_000, 1_000_000, 22),
    3: TrainingBudget(4_000_000, 10_000_000, 60),
}


def shape_for(indices: int, dimension: int, attention: bool = False) -> NetworkShape:
    """The network for a scene of so many `indices` (all stages of all anchors) and latent dimensions."""
    width = 8 * float(np.sqrt(max(indices, 1) / _INDICES_OF_EIGHT))
    hidden = int(np.clip(2 * round(width / 2), _NARROWEST, _WIDEST))
    return NetworkShape(
        hidden=hidden,
        middle=2 * hidden,
        mixer=2 * hidden,
        codeword_dims=min(_CODEWORD_DIMS, dimension),
        attention=attention,
        weight_bits=5 if hidden >= _FINE_WEIGHTS_FROM else 4,
    )


def narrower(shape: NetworkShape) -> NetworkShape | None:
    """A network of about three quarters of the width, for a bounded decoder; None below the narrowest."""
    hidden = 2 * (shape.hidden * 3 // 8)
    return None if hidden < _NARROWEST else replace(shape, hidden=hidden, middle=2 * hidden, mixer=2 * hidden)


def training_for(rows: int, effort: int, seed: int) -> TrainOptions:
    """Training on so many `rows` at an effort level, 1..3."""
    budget = BUDGETS[effort]
    epochs = int(np.clip(round(budget.visits / max(rows, 1)), 2, budget.most_epochs))
    # At least some dozens of steps an epoch; beyond that, larger batches give steadier steps for little more time.
    batch = int(np.clip(1 << (max(rows, 1) // 60).bit_length(), _SMALLEST_BATCH, _LARGEST_BATCH))
    return TrainOptions(epochs=epochs, batch=batch, rate=_RATE, seed=seed)
