"""What a layer of a tile is worth, seen from anywhere."""

from __future__ import annotations

import numpy as np

from scarfmt.arrays import F64
from scarfmt.blocks.streaming import GAIN_OF_ONE, Streaming
from scarfmt.streaming.boxes import Boxes, coverage, octaves

NEAREST = 3
"""Viewpoints that are looked at."""
MOST_RATIO = 4.0
"""How much larger or smaller than from a viewpoint a tile counts at most."""
USUAL_FALL = 0.5
"""What a layer is worth of what the one before was, where nothing is told."""

_GAINS = octaves(-GAIN_OF_ONE - 1, 257)[1:]


def gains_from(eye: F64, boxes: Boxes, streaming: Streaming | None, layers: int) -> F64:
    """(L, T) float64 what each layer of each tile takes away of the squared error of a picture that has it in it.

    Of the nearest viewpoints, those nearer count more; and a tile counts more where it looks larger from `eye` than
    from them. Where a file tells nothing, what looks larger counts more, and later layers less.

    Args:
        eye: (3,) world units.
        boxes: of the T tiles.
        streaming: of the file, or None.
        layers: L of the file.
    """
    size = coverage(boxes, eye)
    if streaming is None or len(streaming.viewpoints) == 0:
        worth = octaves(0, 1)[0]
        falls = np.empty(layers)
        for layer in range(layers):
            worth = worth * USUAL_FALL
            falls[layer] = worth
        return falls[:, None] * size
    levels = np.where(streaming.gains[:, :layers] > 0, _GAINS[streaming.gains[:, :layers]], 0.0)
    total, weights = np.zeros((layers, len(size))), 0.0
    for viewpoint, weight in _nearest(eye, streaming.viewpoints.astype(np.float64)):
        there = coverage(boxes, streaming.viewpoints[viewpoint].astype(np.float64))
        ratio = np.where(there > 0, size / np.where(there > 0, there, 1.0), 1.0)
        ratio = np.minimum(np.maximum(ratio, 1 / MOST_RATIO), MOST_RATIO)
        total = total + weight * (levels[viewpoint] * ratio)
        weights = weights + weight
    return np.asarray(total / weights)


def _nearest(eye: F64, viewpoints: F64) -> list[tuple[int, float]]:
    """The nearest viewpoints, the first of equals first, and what each counts: by distance, the nearest 1."""
    away = viewpoints - eye
    distances = np.sqrt(away[:, 0] * away[:, 0] + away[:, 1] * away[:, 1] + away[:, 2] * away[:, 2])
    order = np.argsort(distances, kind="stable")[:NEAREST]
    least = float(distances[order[0]])
    if least == 0:
        return [(int(order[0]), 1.0)]
    return [(int(number), least / float(distances[number])) for number in order]
