"""Where tiles are, how large they look, and which part of them a camera has in its picture."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from scarfmt.blocks.streaming import Streaming
from scarfmt.container.directory import Tile, tile_table
from scarfmt.container.header import HeaderFields
from scarfmt.container.registries import ColourSpace, CoordinateFrame, Profile
from scarfmt.view_planning import (
    FULL_SPHERE,
    MARGIN,
    Boxes,
    Camera,
    cubes,
    meets_picture,
    octaves,
    share_in_picture,
    solid_angle,
    tight_boxes,
)

FIELDS = HeaderFields(
    Profile.EXPLICIT, 0, 1, 8, (1.0, 2.0, 3.0), 0.5, 0, CoordinateFrame.RDF, ColourSpace.SRGB
)  # fmt: skip
CAMERA = Camera(np.zeros(3), np.array([0.0, 0, 2]), np.array([0.0, 3, 1]), math.radians(60), 400, 200)
EYE = Camera(np.zeros(3), np.array([0.0, 0, 1]), np.array([0.0, -1, 0]), math.radians(60), 640, 480)


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


@pytest.mark.parametrize("size", [1e-320, 1e-160, 1e160, 1e300, 1.7e308])
def test_solid_angle_is_finite_in_worlds_as_large_as_numbers_go(size: float) -> None:
    """A gain that is no number would stand in no order."""
    boxes = Boxes(
        np.array([[0, 0, 0.0], [-1, -1, -1], [1, 1, 1]]) * size, np.array([[1, 1, 1.0], [1, 1, 1], [1, 1, 1]]) * size
    )
    for eye in (np.zeros(3), np.array([size, -size, 0]), np.array([0, 0, 1e3])):
        found = solid_angle(boxes, eye)
        assert ((found >= 0) & (found <= FULL_SPHERE)).all()


def test_solid_angle_is_the_projected_area_by_squared_distance() -> None:
    """The area is right for a face seen straight from far away, from twice as far, and edge on."""
    slab = box((-1, -1, 0), (1, 1, 0))
    assert solid_angle(slab, np.array([0, 0, 10.0]))[0] == pytest.approx(0.04)
    assert solid_angle(slab, np.array([0, 0, 20.0]))[0] == pytest.approx(0.01)
    assert solid_angle(slab, np.array([10.0, 0, 0]))[0] == 0.0


def test_what_is_near_is_all_round() -> None:
    """Within a box, on it, and at a point of no size: never more, never a division by zero."""
    cube = box((-1, -1, -1), (1, 1, 1))
    for eye in ((0, 0, 0), (0.5, 0, 0), (1, 0, 0)):
        assert solid_angle(cube, np.array(eye, float))[0] == FULL_SPHERE
    point = box((1, 1, 1), (1, 1, 1))
    assert solid_angle(point, np.array([1.0, 1, 1]))[0] == FULL_SPHERE
    assert solid_angle(point, np.array([0.0, 1, 1]))[0] == 0.0


def point(x: float, y: float, z: float) -> Boxes:
    at = np.array([[x, y, z]])
    return Boxes(at, at)


def test_the_picture_has_four_sides_and_a_front() -> None:
    """A margin wider than it is; twice as wide as high here."""
    edge = MARGIN * math.tan(math.radians(30))
    for x, y, z, seen in (
        (0, 0, 1, 1), (0, 0, -1, 0), (0, 0.99 * edge, 1, 1), (0, 1.01 * edge, 1, 0), (0, -0.99 * edge, 1, 1),
        (0, -1.01 * edge, 1, 0), (1.99 * edge, 0, 1, 1), (2.01 * edge, 0, 1, 0), (-1.99 * edge, 0, 1, 1),
        (-2.01 * edge, 0, 1, 0),
    ):  # fmt: skip
        at = point(x, y, z)
        assert share_in_picture(at, CAMERA)[0] == meets_picture(at, CAMERA)[0] == seen, (x, y, z)


def test_a_box_is_in_it_by_its_part() -> None:
    """Half behind the eye is half; a box that is twice as high as the picture is half in it."""
    half = Boxes(np.array([[-1e-3, -1e-3, -1.0]]), np.array([[1e-3, 1e-3, 1.0]]))
    assert share_in_picture(half, CAMERA).tolist() == [0.5]
    high = MARGIN * math.tan(math.radians(30)) * 100
    for factor, part in ((1.3, 1.0), (2.0, 0.5)):
        box = Boxes(np.array([[-1, -factor * high, 100.0]]), np.array([[1, factor * high, 100.0]]))
        assert share_in_picture(box, CAMERA).tolist() == [part]


def test_a_moving_camera_is_looked_from_where_it_will_be() -> None:
    moving = replace(CAMERA, velocity=np.array([0.0, 8.0, 0.0]))
    for eye, seen in ((moving, 1), (CAMERA, 0)):
        assert share_in_picture(point(0, 5, 2), eye)[0] == meets_picture(point(0, 5, 2), eye)[0] == seen


def test_only_what_is_wholly_outside_does_not_meet_the_picture() -> None:
    """A large box with the eye in it may have none of the places that a share is counted by in the picture."""

    def meets(low: list[float], high: list[float]) -> bool:
        return bool(meets_picture(Boxes(np.array([low]), np.array([high])), EYE)[0])

    assert meets([-100, -100, -100], [100, 100, 100])
    assert meets([-1, -1, 5], [1, 1, 6])
    assert not meets([-1, -1, -6], [1, 1, -5])
    assert not meets([50, -1, 5], [51, 1, 6])
    assert not meets([-1, 50, 5], [1, 51, 6])
    assert meets([3, 0, 5], [90, 1, 6])
