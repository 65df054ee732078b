"""The places of tiles, and how large they look."""

from __future__ import annotations

import numpy as np
import pytest

from scarfmt.blocks.streaming import Streaming
from scarfmt.container.directory import Tile, tile_table
from scarfmt.container.header import HeaderFields
from scarfmt.container.registries import ColourSpace, CoordinateFrame, Profile
from scarfmt.streaming.boxes import ALL_ROUND, Boxes, coverage, cubes, octaves, tight_boxes

FIELDS = HeaderFields(
    Profile.EXPLICIT, 0, 1, 8, (1.0, 2.0, 3.0), 0.5, 0, CoordinateFrame.RDF, ColourSpace.SRGB
)  # fmt: skip


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Boxes:
    return Boxes(np.array([low]), np.array([high]))


def test_octaves_are_powers_of_two() -> None:
    """The table that stands for exp2, which languages round differently; whole powers exactly."""
    found = octaves(-128, 256)
    assert found == pytest.approx(2.0 ** ((np.arange(256) - 128) / 4), rel=1e-15)
    assert found[::4].tolist() == [2.0**k for k in range(-32, 32)]


def test_cubes_are_those_of_the_tile_table() -> None:
    """Half the lattice a side, at depth 1: 128 steps of half a unit."""
    found = cubes(FIELDS, tile_table([Tile(1, 0, 0), Tile(1, 0, 5)]))
    assert found.tolist() == [[1.0, 2.0, 3.0, 65.0, 66.0, 67.0], [65.0, 2.0, 67.0, 129.0, 66.0, 131.0]]


def test_boxes_are_in_256ths_and_reaches_in_quarter_octaves() -> None:
    """Half of a reach counts; without a block boxes are whole cubes."""
    tiles = cubes(FIELDS, tile_table([Tile(1, 0, 0)]))
    told = Streaming(
        np.array([[0, 64, 255]], np.uint8),
        np.array([[255, 127, 255]], np.uint8),
        np.array([120], np.uint8),
        np.zeros((0, 3), np.float32),
        np.zeros((0, 1, 1), np.uint8),
    )
    found = tight_boxes(tiles, told)
    assert found.low.tolist() == [[1.0 - 8, 18.0 - 8, 66.75 - 8]]
    assert found.high.tolist() == [[65.0 + 8, 34.0 + 8, 67.0 + 8]]
    told.reach[:] = 0
    found = tight_boxes(tiles, told)
    assert found.low.tolist() == [[1.0, 18.0, 66.75]]
    assert found.high.tolist() == [[65.0, 34.0, 67.0]]
    whole = tight_boxes(tiles, None)
    assert (whole.high - whole.low).tolist() == [[64.0, 64.0, 64.0]]


def test_coverage_is_the_projected_area_by_squared_distance() -> None:
    """The area is right for a face seen straight from far away, from twice as far, and edge on."""
    slab = box((-1, -1, 0), (1, 1, 0))
    assert coverage(slab, np.array([0, 0, 10.0]))[0] == pytest.approx(0.04)
    assert coverage(slab, np.array([0, 0, 20.0]))[0] == pytest.approx(0.01)
    assert coverage(slab, np.array([10.0, 0, 0]))[0] == 0.0


def test_what_is_near_is_all_round() -> None:
    """Within a box, on it, and at a point of no size: never more, never a division by zero."""
    cube = box((-1, -1, -1), (1, 1, 1))
    for eye in ((0, 0, 0), (0.5, 0, 0), (1, 0, 0)):
        assert coverage(cube, np.array(eye, float))[0] == ALL_ROUND
    point = box((1, 1, 1), (1, 1, 1))
    assert coverage(point, np.array([1.0, 1, 1]))[0] == ALL_ROUND
    assert coverage(point, np.array([0.0, 1, 1]))[0] == 0.0
