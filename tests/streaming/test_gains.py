"""What a layer of a tile is worth from anywhere: what the nearest viewpoints say, by how large it looks."""

from __future__ import annotations

import numpy as np
import pytest

from scarfmt.blocks.streaming import Streaming
from scarfmt.streaming.boxes import Boxes, coverage
from scarfmt.streaming.gains import MOST_RATIO, gains_from

BOXES = Boxes(np.array([[-0.5, -0.5, 9.5]]), np.array([[0.5, 0.5, 10.5]]), np.zeros(1))


def told(places: list[list[float]], levels: list[int]) -> Streaming:
    """One tile, one layer."""
    gains = np.array(levels, np.uint8).reshape(-1, 1, 1)
    corners = np.zeros((1, 3), np.uint8), np.full((1, 3), 255, np.uint8)
    return Streaming(*corners, np.zeros(1, np.uint8), np.array(places, np.float32).reshape(-1, 3), gains)


def test_at_a_viewpoint_it_is_what_the_file_says() -> None:
    """In quarter octaves of a squared error of 1; 0 is nothing."""
    here = np.zeros(3)
    other = [0.0, 0, -1]
    for level, gain in ((255, 1.0), (251, 0.5), (1, 2.0**-63.5), (0, 0.0)):
        assert gains_from(here, BOXES, told([[0, 0, 0], other], [level, 200]), 1)[0, 0] == pytest.approx(gain)


def test_between_viewpoints_the_nearer_counts_more() -> None:
    """And no more than three are asked."""
    places = [[1.0, 0, 0], [0, 2.0, 0], [0, 0, -50.0], [0, 0, -60.0]]
    found = gains_from(np.zeros(3), BOXES, told(places, [255, 1, 1, 255]), 1)[0, 0]
    ratio = coverage(BOXES, np.zeros(3))[0] / coverage(BOXES, np.array(places[0]))[0]
    assert found == pytest.approx(ratio * 1 / (1 + 1 / 2 + 1 / 50), rel=1e-9)


def test_what_looks_larger_counts_more_but_not_without_end() -> None:
    """From half as far four times; from the tile itself no more."""
    far = told([[0, 0, -10.0]], [251])
    assert gains_from(np.array([0, 0, 0.0]), BOXES, far, 1)[0, 0] == pytest.approx(0.5 * MOST_RATIO, rel=0.05)
    assert gains_from(np.array([0, 0, 9.0]), BOXES, far, 1)[0, 0] == 0.5 * MOST_RATIO
    assert gains_from(np.array([0, 0, -90.0]), BOXES, far, 1)[0, 0] == 0.5 / MOST_RATIO


def test_where_nothing_is_told_size_decides_and_later_layers_count_less() -> None:
    """Without a block, and with one that has no viewpoints."""
    for streaming in (None, told([], [])):
        found = gains_from(np.zeros(3), BOXES, streaming, 3)
        assert (found[:, 0] / coverage(BOXES, np.zeros(3))[0]).tolist() == [0.5, 0.25, 0.125]


def test_layers_that_the_file_lacks_are_left_out() -> None:
    """Of a file that was cut."""
    streaming = Streaming(
        *(np.zeros((1, 3), np.uint8), np.full((1, 3), 255, np.uint8)),
        np.zeros(1, np.uint8),
        np.zeros((1, 3), np.float32),
        np.arange(200, 205, dtype=np.uint8).reshape(1, 5, 1),
    )
    assert gains_from(np.zeros(3), BOXES, streaming, 2).shape == (2, 1)
