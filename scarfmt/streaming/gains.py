"""The gain of a layer of a tile, seen from any place."""

from __future__ import annotations

import numpy as np

from scarfmt.arrays import F64
from scarfmt.blocks.streaming import GAIN_OF_ONE, Streaming
from scarfmt.streaming.boxes import Boxes, coverage, octaves

MOST_RATIO = 100.0
"""How much larger or smaller than from a viewpoint a tile counts at most."""
USUAL_FALL = 0.5
"""The usual gain of a byte of a layer, relative to a byte of the layer before."""

USUAL_WEIGHT = 3.0
"""The weight of the usual gain, in viewpoints at the distance of the tile."""

_GAINS = octaves(-GAIN_OF_ONE - 1, 257)[1:]


def gains_from(eye: F64, boxes: Boxes, streaming: Streaming | None, costs: F64) -> F64:
    """(L, T) float64 what each layer of each tile takes away of the squared error of a picture that has it in it.

    What the file tells is of other places, and what is usual of no place: the nearer the viewpoints, beside how far the
    tile is, the more counts what is told. Where the file tells nothing, all is as usual, in some unit.

    Args:
        eye: (3,) world units.
        boxes: of the T tiles.
        streaming: of the file, or None.
        costs: (L, T) float64 bytes.
    """
    usual = usual_gains(eye, boxes, costs)
    if streaming is None or len(streaming.viewpoints) == 0:
        return usual
    told = told_gains(eye, boxes, streaming, len(costs))
    whole, all_usual = _total(told), _total(usual)
    if not (whole > 0 and all_usual > 0):
        return usual
    told_part = trust(eye, boxes, streaming.viewpoints.astype(np.float64))
    return told_part * told + (1 - told_part) * (usual * (whole / all_usual))


def trust(eye: F64, boxes: Boxes, viewpoints: F64) -> F64:
    """Part of a gain that comes from viewpoints, (T,) float64; the rest is the usual gain.

    Args:
        eye: (3,) world units.
        boxes: of the T tiles.
        viewpoints: (V, 3), one at least.
    """
    away = boxes.middle - eye
    squared = away[:, 0] * away[:, 0] + away[:, 1] * away[:, 1] + away[:, 2] * away[:, 2]
    near = viewpoints - eye
    least = float((near[:, 0] * near[:, 0] + near[:, 1] * near[:, 1] + near[:, 2] * near[:, 2]).min())
    total = 0.0
    for weight in _weights(eye, viewpoints):
        total += weight
    far = USUAL_WEIGHT * (least / total)
    return np.where(squared + far > 0, squared / np.where(squared + far > 0, squared + far, 1.0), 1.0)


def _total(gains: F64) -> float:
    """The sum, one after another: sums of arrays are added up in an order of their own."""
    total = 0.0
    for gain in gains.ravel().tolist():
        total += gain
    return total


def told_gains(eye: F64, boxes: Boxes, streaming: Streaming, layers: int) -> F64:
    """The gains in the file, (L, T) float64.

    A mean of what is told from all viewpoints, of which there is one at least: the nearer ones count more, by the
    square of their distance; and a tile counts more where it looks larger from `eye` than from there.

    Args:
        eye: (3,) world units.
        boxes: of the T tiles.
        streaming: of the file.
        layers: L of the file.
    """
    size = coverage(boxes, eye)
    levels = np.where(streaming.gains[:, :layers] > 0, _GAINS[streaming.gains[:, :layers]], 0.0)
    total, weights = np.zeros((layers, len(size))), 0.0
    viewpoints = streaming.viewpoints.astype(np.float64)
    for viewpoint, weight in enumerate(_weights(eye, viewpoints)):
        there = coverage(boxes, viewpoints[viewpoint])
        ratio = np.where(there > 0, size / np.where(there > 0, there, 1.0), 1.0)
        ratio = np.minimum(np.maximum(ratio, 1 / MOST_RATIO), MOST_RATIO)
        total = total + weight * (levels[viewpoint] * ratio)
        weights = weights + weight
    return np.asarray(total / weights)


def usual_gains(eye: F64, boxes: Boxes, costs: F64) -> F64:
    """(L, T) float64 what is usual: what looks larger counts more, and later layers less.

    Args:
        eye: (3,) world units.
        boxes: of the T tiles.
        costs: (L, T) float64 bytes: encoders spend more where there is more to see.
    """
    size, worth, out = coverage(boxes, eye), 1.0, np.empty(costs.shape)
    for layer in range(len(costs)):
        worth = worth * USUAL_FALL
        out[layer] = worth * size * costs[layer]
    return out


def _weights(eye: F64, viewpoints: F64) -> list[float]:
    """The weight of each viewpoint. If the eye is at a viewpoint, that one alone counts."""
    away = viewpoints - eye
    squared = away[:, 0] * away[:, 0] + away[:, 1] * away[:, 1] + away[:, 2] * away[:, 2]
    least = float(squared.min())
    if least == 0:
        return [1.0 if number == int(squared.argmin()) else 0.0 for number in range(len(squared))]
    return [least / float(value) for value in squared]
