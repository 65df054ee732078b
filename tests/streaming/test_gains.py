"""The gain of a layer of a tile from any place: the gains of viewpoints, and by how large the tile looks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scarfmt.blocks.streaming import Streaming
from scarfmt.streaming.boxes import Boxes, coverage
from scarfmt.streaming.gains import MOST_RATIO, USUAL_WEIGHT, gains_from, told_gains, trust, usual_gains

BOXES = Boxes(np.array([[-0.5, -0.5, 9.5]]), np.array([[0.5, 0.5, 10.5]]))


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
        assert told_gains(here, BOXES, told([[0, 0, 0], other], [level, 200]), 1)[0, 0] == pytest.approx(gain)


def test_between_viewpoints_the_nearer_counts_more() -> None:
    """By the square of the distance."""
    places = [[1.0, 0, 0], [0, 2.0, 0]]
    found = told_gains(np.zeros(3), BOXES, told(places, [255, 0]), 1)[0, 0]
    ratio = coverage(BOXES, np.zeros(3))[0] / coverage(BOXES, np.array(places[0]))[0]
    assert found == pytest.approx(ratio * 1 / (1 + 1 / 4), rel=1e-9)


def test_what_looks_larger_counts_more_but_not_without_end() -> None:
    """From half as far four times; from the tile itself no more than a hundred times."""
    far = told([[0, 0, -10.0]], [251])
    assert told_gains(np.array([0, 0, 0.0]), BOXES, far, 1)[0, 0] == pytest.approx(0.5 * 4, rel=0.05)
    assert told_gains(np.array([0, 0, 10.0]), BOXES, far, 1)[0, 0] == 0.5 * MOST_RATIO
    assert told_gains(np.array([0, 0, -990.0]), BOXES, far, 1)[0, 0] == 0.5 / MOST_RATIO


def test_usually_size_decides_and_later_layers_count_less() -> None:
    """A byte of a layer is worth half of what one of the layer before was."""
    found = usual_gains(np.zeros(3), BOXES, np.array([[100.0], [100.0], [1000.0]]))
    size = coverage(BOXES, np.zeros(3))[0]
    assert found[:, 0].tolist() == [50 * size, 25 * size, 125 * size]


def test_what_is_told_counts_by_how_near_it_is_told_from() -> None:
    """A tile 10 away: of viewpoints at 10 it needs three to count as much as what is usual."""
    eye = np.zeros(3)
    ten, five = [10.0, 0, 0], [0, 5.0, 0]
    assert trust(eye, BOXES, np.array([ten])) == pytest.approx([1 / (1 + USUAL_WEIGHT)])
    assert trust(eye, BOXES, np.array([ten, ten, ten])) == pytest.approx([0.5])
    assert trust(eye, BOXES, np.array([five, ten])) == pytest.approx([5 / (5 + USUAL_WEIGHT)])
    assert trust(eye, BOXES, np.array([[0.0, 0, 0], ten])).tolist() == [1.0]
    middle = np.array([0.0, 0, 10])
    assert trust(middle, BOXES, np.array([ten])).tolist() == [0.0]
    assert trust(middle, BOXES, np.array([middle])).tolist() == [1.0]


def test_what_is_told_and_what_is_usual_are_of_one_size() -> None:
    """Trust alone then decides between them; without gains in the file the usual gains are used."""
    eye, costs = np.zeros(3), np.array([[100.0], [100.0]])
    usual = usual_gains(eye, BOXES, costs)
    streaming = replace(told([[1, 0, 0]], [200]), gains=np.array([[[200], [220]]], np.uint8))
    told_alone, found = told_gains(eye, BOXES, streaming, 2), gains_from(eye, BOXES, streaming, costs)
    part = trust(eye, BOXES, np.array([[1.0, 0, 0]]))[0]
    assert found == pytest.approx(part * told_alone + (1 - part) * usual * told_alone.sum() / usual.sum())
    assert found.sum() == pytest.approx(told_alone.sum())
    for nothing in (None, told([], []), replace(streaming, gains=np.zeros((1, 2, 1), np.uint8))):
        assert np.array_equal(gains_from(eye, BOXES, nothing, costs), usual)


def test_layers_that_the_file_lacks_are_left_out() -> None:
    """A file that was truncated lacks some layers."""
    streaming = Streaming(
        *(np.zeros((1, 3), np.uint8), np.full((1, 3), 255, np.uint8)),
        np.zeros(1, np.uint8),
        np.zeros((1, 3), np.float32),
        np.arange(200, 205, dtype=np.uint8).reshape(1, 5, 1),
    )
    assert told_gains(np.zeros(3), BOXES, streaming, 2).shape == (2, 1)
