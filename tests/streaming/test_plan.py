"""In which order layers of tiles are fetched: no holes first, then what gains most a byte."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scarfmt.blocks.streaming import Streaming, read_streaming
from scarfmt.container.file import Container
from scarfmt.container.schema import BlockKind
from scarfmt.container.source import open_source
from scarfmt.streaming.plan import SceneIndex, Step, affordable, plan
from scarfmt.streaming.view import Camera
from tests.conftest import REPOSITORY
from tests.streaming.plan_cases import CASES, answer, random_case

TOYS = REPOSITORY / "web" / "test" / "data" / "toys.scar"
FORWARD, UP = np.array([0.0, 0, 1]), np.array([0.0, 1, 0])


def row(tiles: int, layers: int, size: float = 1000.0) -> SceneIndex:
    """Cubes of one unit in a row along x, at a distance of 5, all blocks alike."""
    low = np.stack([np.arange(tiles) * 2.0 - tiles + 0.5, np.full(tiles, -0.5), np.full(tiles, 5.0)], axis=1)
    shape = (tiles, layers)
    return SceneIndex(
        np.concatenate([low, low + 1], axis=1), np.full(shape, size), np.full(shape, 10), np.zeros(layers)
    )


def told(gains: list[list[int]]) -> Streaming:
    """Gains by layer and tile from one viewpoint at the origin, whole cubes."""
    levels = np.array([gains], np.uint8)
    tiles = levels.shape[2]
    corners = np.zeros((tiles, 3), np.uint8), np.full((tiles, 3), 255, np.uint8)
    return Streaming(*corners, np.zeros(tiles, np.uint8), np.zeros((1, 3), np.float32), levels)


CAMERA = Camera(np.zeros(3), FORWARD, UP, 1.0, 400, 300)


def test_first_layers_in_the_picture_come_before_anything_else() -> None:
    """However much a later layer gains; those that gain most a byte first."""
    steps = plan(row(3, 2), told([[10, 10, 10], [250, 250, 250]]), CAMERA, [0, 0, 0])
    assert [layer for _, layer in steps] == [1, 1, 1, 2, 2, 2]
    steps = plan(row(3, 2), told([[205, 220, 190], [9, 9, 9]]), CAMERA, [0, 0, 0])
    assert steps[:3] == [Step(1, 1), Step(0, 1), Step(2, 1)]


def test_what_is_not_in_the_picture_comes_after_what_gains_as_much() -> None:
    """Tiles outside the picture come last but do come: a camera may turn."""
    index = row(2, 1)
    away = replace(index, cubes=np.concatenate([index.cubes[:1], index.cubes[1:] * [1, 1, -1, 1, 1, -1]]))
    steps = plan(away, None, CAMERA, [0, 0])
    assert steps == [Step(0, 1), Step(1, 1)]
    assert plan(away, None, replace(CAMERA, forward=-FORWARD), [0, 0]) == [Step(1, 1), Step(0, 1)]


def test_layers_that_only_pay_together_go_together() -> None:
    """A layer of no gain, and one after it that gains more than any: both before another tile's second layer."""
    steps = plan(row(2, 3), told([[100, 100], [0, 120], [140, 100]]), CAMERA, [1, 1])
    assert steps == [Step(0, 2), Step(0, 3), Step(1, 2), Step(1, 3)]


def test_bytes_are_what_gains_are_divided_by() -> None:
    """Half the bytes at the same gain come first; and models that are missing count."""
    index = row(2, 2)
    cheap = replace(index, bytes=np.array([[1000.0, 1000], [1000, 500]]))
    assert plan(cheap, told([[9, 9], [100, 100]]), CAMERA, [1, 1]) == [Step(1, 2), Step(0, 2)]
    dear = replace(index, model_bytes=np.array([0.0, 1e6]))
    mixed = told([[100, 150], [160, 130]])
    assert plan(index, mixed, replace(CAMERA, forward=-FORWARD), [1, 0])[0] == Step(0, 2)
    assert plan(dear, mixed, replace(CAMERA, forward=-FORWARD), [1, 0])[0] == Step(1, 1)


def test_a_moving_camera_is_planned_for_where_it_will_be() -> None:
    """Half a second ahead: three tiles further."""
    index = row(9, 1)
    still, moving = (
        plan(index, None, replace(CAMERA, velocity=velocity), [0] * 9)[0].tile
        for velocity in (None, np.array([12.0, 0, 0]))
    )
    assert moving == still + 3


def test_equal_gains_go_by_layer_then_tile() -> None:
    """Every implementation then decides alike."""
    index = row(3, 2)
    alike = replace(index, cubes=index.cubes[[1, 1, 1]])
    assert plan(alike, told([[50] * 3, [50] * 3]), CAMERA, [0, 0, 0]) == [
        Step(tile, layer) for layer in (1, 2) for tile in range(3)
    ]


@given(st.integers(0, 10_000))
def test_every_missing_step_comes_once_and_in_turn(seed: int) -> None:
    """The order is complete whatever gains the file has and wherever the camera looks."""
    case = random_case(seed)
    steps = answer(case)
    missing = [[t, k] for t in range(case["tiles"]) for k in range(case["have"][t] + 1, case["layers"] + 1)]
    assert sorted(steps) == missing
    places = {tuple(step): place for place, step in enumerate(steps)}
    assert all(places[t, k] < places[t, k + 1] for t, k in places if (t, k + 1) in places)


def test_without_a_camera_the_order_is_that_of_the_file() -> None:
    assert plan(row(2, 2), None, None, [1, 0]) == [Step(1, 1), Step(0, 2), Step(1, 2)]


def test_what_does_not_fit_ends_the_plan() -> None:
    """The first step beyond a budget, also if a smaller one would fit after it; models are counted when they come."""
    index = replace(row(2, 2), model_bytes=np.array([100.0, 900]), bytes=np.array([[1000.0, 10], [1000, 2000]]))
    steps = [Step(0, 1), Step(1, 1), Step(1, 2), Step(0, 2)]
    assert affordable(index, steps, size=2100, splats=1e9) == steps[:2]
    assert affordable(index, steps, size=2099, splats=1e9) == steps[:1]
    assert affordable(index, steps, size=4999, splats=1e9) == steps[:2]
    assert affordable(index, steps, size=5010, splats=1e9) == steps
    assert affordable(index, steps, size=1e9, splats=20) == steps[:2]


def test_the_stored_answers_are_those_of_today() -> None:
    """The planner of the browser package is tested on these answers. To make them anew: python -m
    tests.streaming.plan_cases."""
    cases = json.loads(CASES.read_text())
    assert len(cases) > 5
    for case in cases:
        assert answer(case) == case["steps"]


def test_a_file_is_read_as_the_planner_wants_it() -> None:
    """Sizes and counts of all TILE blocks, models by layer; the annotation is none of them."""
    with open_source(str(TOYS)) as source:
        container = Container.open(source).load()
        index = SceneIndex.of(container)
        assert read_streaming(container) is None
    header = container.header
    assert index.counts.sum() == header.anchor_count
    sizes = [layer.byte_count for layer in header.layers]
    metadata = container.find(BlockKind.METADATA, 1)
    sizes[0] -= metadata.length if metadata else 0
    assert (index.bytes.sum(axis=0) + index.model_bytes).tolist() == sizes
    assert (index.cubes[:, 3:] > index.cubes[:, :3]).all()
    assert len(plan(index, None, CAMERA, [0] * header.tile_count)) == header.tile_count * header.layer_count


@pytest.mark.parametrize("seed", [0, 1])
def test_the_same_question_has_the_same_answer(seed: int) -> None:
    assert answer(random_case(seed)) == answer(random_case(seed))
