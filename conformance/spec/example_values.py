"""Worked examples of SPEC.md §7.13 and §9: widths, positions, rotation, opacity, colour, gains."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from conformance.decoders.python.decoder import cell_width, f32, lattice_place
from conformance.decoders.python.streaming import parse_streaming
from conformance.expect.activated import colours, logits, rotations, sigmoid
from conformance.writer.streaming import streaming_block
from scarfmt.blocks.streaming import GAIN_OF_ONE, GAIN_STEPS, REACH_OF_SIDE, Streaming

FIRST_WIDTH, VALUE, STEPS = 0.7, 7, 3
CORNER, LOCAL, SHIFT, RESIDUAL, RESIDUAL_STEPS = 16, 3, 2, -4, 2
ORIGIN, VOXEL = -1.0, 0.25
ROTATION = (0.5, -0.25, 1.0)
LOG_OPACITIES = (-0.7, 0.0)
COLOUR = (1.0, 0.25, -0.5)
VIEWPOINTS, LAYERS, TILES = 2, 3, 5
GAIN_AT, GAIN = (1, 2, 3), 235
"""Viewpoint, layer and tile of a gain, and the gain."""
REACH, SIDE = 124, 2.0
LOW, HIGH = 64, 191


class Value(NamedTuple):
    """A channel value: w(n), the product in f64, the value, and w(n) as it is not to be computed."""

    width: float
    product: float
    value: float
    divided_again: float


def value() -> Value:
    """The value of VALUE after STEPS steps (SPEC §9.2)."""
    width, again = cell_width(FIRST_WIDTH, STEPS), FIRST_WIDTH
    for _ in range(STEPS - 1):
        again = again / 3
    if again == width:
        raise ValueError(f"{FIRST_WIDTH} does not tell the ways to divide apart")
    return Value(width, float(VALUE) * width, f32(float(VALUE) * width), again)


def position() -> tuple[float, float, float]:
    """r, t and the position along one axis (SPEC §9.1)."""
    r = float(RESIDUAL) * cell_width(1 / 3, RESIDUAL_STEPS)
    t = lattice_place(CORNER, LOCAL, SHIFT, r)
    return r, t, ORIGIN + VOXEL * t


def rotation() -> list[float]:
    """The quaternion w, x, y, z of ROTATION (SPEC §9.3)."""
    found: list[float] = rotations(np.array([ROTATION]))[0].tolist()
    return found


def opacities() -> list[tuple[float, float]]:
    """Logit and opacity of each of LOG_OPACITIES (SPEC §9.4)."""
    found = logits(np.array(LOG_OPACITIES))
    return list(zip(found.tolist(), sigmoid(found).tolist(), strict=True))


def colour() -> list[float]:
    """The degree-0 coefficients of COLOUR (SPEC §9.4)."""
    found: list[float] = colours(np.array([COLOUR]))[0][0].tolist()
    return found


def gain_byte() -> int:
    """Which of the bytes of `gains` holds the gain at GAIN_AT: the one that the second decoder reads there."""
    viewpoint, layer, tile = GAIN_AT
    for byte in range(VIEWPOINTS * LAYERS * TILES):
        gains = np.zeros(VIEWPOINTS * LAYERS * TILES, np.uint8)
        gains[byte] = GAIN
        block = streaming_block(_streaming(gains.reshape(VIEWPOINTS, LAYERS, TILES)))
        if parse_streaming(block)["gains"][viewpoint][layer - 1][tile] == GAIN:
            return byte
    raise ValueError("no byte is read there")


def _streaming(gains: np.ndarray[tuple[int, int, int], np.dtype[np.uint8]]) -> Streaming:
    corners, reach = np.zeros((TILES, 3), np.uint8), np.zeros(TILES, np.uint8)
    return Streaming(corners, corners, reach, np.zeros((VIEWPOINTS, 3), np.float32), gains)


def gain_share() -> float:
    """The squared error that GAIN stands for (SPEC §7.13)."""
    return float(2.0 ** ((GAIN - GAIN_OF_ONE) / GAIN_STEPS))


def reach() -> float:
    """How far the splats of a tile of side SIDE stick out of its tight box."""
    return float(SIDE * 2.0 ** ((REACH - REACH_OF_SIDE) / GAIN_STEPS))


def tight_box() -> tuple[float, float]:
    """Where the tight box of a tile of side SIDE is, from the corner on."""
    return SIDE * LOW / 256, SIDE * (HIGH + 1) / 256
