"""How large an index network a scene can pay for, and how long to train it: as measured on real scenes.

A network costs its bytes once and saves a share of every index, so the best width grows about with the square root
of the number of indices: from 8 for 75 thousand to 32 for a million.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from reference_encoder.networks.shape import NetworkShape
from reference_encoder.networks.train import TrainOptions
from reference_encoder.options import EFFORTS
from reference_encoder.tuning import (
    CODEWORD_DIMS,
    FINE_WEIGHTS_FROM,
    INDEX_LEARNING_RATE,
    INDICES_OF_EIGHT,
    LARGEST_BATCH,
    NARROWEST_HIDDEN,
    SMALLEST_BATCH,
    WIDEST_HIDDEN,
)


def shape_for(indices: int, dimension: int, attention: bool = False) -> NetworkShape:
    """The network for a scene of so many `indices` (all stages of all anchors) and latent dimensions."""
    width = 8 * float(np.sqrt(max(indices, 1) / INDICES_OF_EIGHT))
    hidden = int(np.clip(2 * round(width / 2), NARROWEST_HIDDEN, WIDEST_HIDDEN))
    return NetworkShape(
        hidden=hidden,
        middle=2 * hidden,
        mixer=2 * hidden,
        codeword_dims=min(CODEWORD_DIMS, dimension),
        attention=attention,
        weight_bits=5 if hidden >= FINE_WEIGHTS_FROM else 4,
    )


def narrower(shape: NetworkShape) -> NetworkShape | None:
    """A network of about three quarters of the width, for a bounded decoder; None below the narrowest."""
    hidden = 2 * (shape.hidden * 3 // 8)
    return None if hidden < NARROWEST_HIDDEN else replace(shape, hidden=hidden, middle=2 * hidden, mixer=2 * hidden)


def training_for(rows: int, effort: int, seed: int) -> TrainOptions:
    """Training on so many `rows` at an effort level, 1..3."""
    budget = EFFORTS[effort].training
    epochs = int(np.clip(round(budget.visits / max(rows, 1)), 2, budget.most_epochs))
    # At least some dozens of steps an epoch; beyond that, larger batches give steadier steps for little more time.
    batch = int(np.clip(1 << (max(rows, 1) // 60).bit_length(), SMALLEST_BATCH, LARGEST_BATCH))
    return TrainOptions(epochs=epochs, batch=batch, learning_rate=INDEX_LEARNING_RATE, seed=seed)
