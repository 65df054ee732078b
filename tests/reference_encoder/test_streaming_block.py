"""The STREAMING block of a file: boxes around what is there, and a view to begin with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from reference_encoder.encode import EncodeOptions, Encoder, encode, measure_scene
from reference_encoder.judge.reconstruct import reconstruct_anchors, reconstruct_gaussians
from reference_encoder.opening_view import find_opening_view
from reference_encoder.streaming_block import build_streaming_block, describe_view, measure_boxes
from scarfmt.blocks.streaming import Streaming, read_streaming
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.directory import tile_table
from scarfmt.container.file import Container
from scarfmt.container.source import BytesSource
from scarfmt.render.camera import look_at
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.view_planning import cubes, tight_boxes
from tests.reference_encoder.profiles.test_anchors import ring, small_model

UP = np.array([0.0, 1.0, 0.0])
NEAR_LEFT, NEAR_RIGHT = (
    look_at(np.array([x, 0.0, 3.0]), np.array([x, 0.0, 0.0]), UP, 160, 120, 50.0) for x in (-6.0, 6.0)
)
OPTIONS = EncodeOptions(
    effort=1, layers=3, quality=38, corrections=0, tile_anchors=1024, cameras=[NEAR_LEFT, NEAR_RIGHT]
)


@pytest.fixture(scope="module")
def source() -> GaussianScene:
    """Two spheres of 1,500 Gaussians each, left and right."""
    draw = np.random.default_rng(2)
    count = 3000
    normal = draw.normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    middle = np.array([[-6.0, 0, 0], [6.0, 0, 0]])[np.arange(count) % 2]
    return GaussianScene(
        middle + normal,
        np.log(draw.uniform(0.03, 0.1, (count, 3))).astype(np.float32),
        draw.normal(size=(count, 4)).astype(np.float32),
        draw.normal(1, 2, count).astype(np.float32),
        draw.normal(0, 0.4, (count, 4, 3)).astype(np.float32),
    )


@pytest.fixture(scope="module")
def scene(source: GaussianScene) -> QuantisedScene:
    """All integers of its file."""
    return Encoder(measure_scene(source, OPTIONS)).run().scene


def build(scene: QuantisedScene, options: EncodeOptions = OPTIONS) -> Streaming:
    drawn = reconstruct_gaussians(scene)
    return build_streaming_block(scene, drawn, find_opening_view(drawn, options))


def test_boxes_hold_what_is_there_and_hardly_more(scene: QuantisedScene) -> None:
    """Every Gaussian's place, to a step of 1/256 of the tile; reaches are of the size of splats."""
    streaming = build(scene)
    every = cubes(scene.fields, tile_table(scene.tiles))
    boxes = tight_boxes(every, replace(streaming, reach=np.zeros_like(streaming.reach)))
    out = tight_boxes(every, streaming).high - boxes.high
    edges = np.cumsum([len(content) for content in scene.contents])[:-1]
    for number, places in enumerate(np.split(reconstruct_gaussians(scene).positions, edges)):
        step = (boxes.high[number] - boxes.low[number]) / (
            streaming.high[number].astype(float) + 1 - streaming.low[number]
        )
        # A place may lie half a cell outside its cube (SPEC §9.1).
        beside = scene.fields.voxel * 2 ** scene.tiles[number].shift / 2 + 1e-9
        assert (places >= boxes.low[number] - beside).all()
        assert (places <= boxes.high[number] + beside).all()
        assert (places.min(axis=0) < boxes.low[number] + step + 1e-9).all()
        assert (places.max(axis=0) > boxes.high[number] - step - 1e-9).all()
    assert (out < 0.25).all()
    assert (out > 0).any()


@pytest.mark.parametrize(("part", "level"), [(0.5, 128), (-1e-4, 0), (1 + 1e-4, 255)])
def test_what_lies_in_one_place_has_a_box_of_one_step(scene: QuantisedScene, part: float, level: int) -> None:
    """On a border of steps, and half a cell outside the cube too."""
    exact = replace(scene.fields, origin=(0.0, 0.0, 0.0), voxel=1.0)
    alone = replace(scene, fields=exact, tiles=scene.tiles[:1], contents=scene.contents[:1])
    drawn, (cube,) = reconstruct_gaussians(alone), cubes(alone.fields, tile_table(alone.tiles))
    places = np.tile(cube[:3] + part * (cube[3:] - cube[:3]), (len(drawn), 1))
    low, high, _ = measure_boxes(alone, replace(drawn, positions=places))
    assert low.tolist() == high.tolist() == [[level] * 3]


def test_the_first_view_is_a_camera_that_looks_at_the_scene(scene: QuantisedScene) -> None:
    """It is one of the given cameras; without cameras a sphere is before it."""
    given, free = build(scene).view, build(scene, replace(OPTIONS, cameras=None)).view
    assert np.abs(given.position).tolist() == [6.0, 0.0, 3.0]
    assert given.up @ UP == pytest.approx(1)
    assert given.fov == pytest.approx(2 * np.arctan(60 / NEAR_LEFT.fy))
    forward = free.target - free.position
    towards = [np.array([x, 0, 0]) - free.position for x in (-6.0, 6.0)]
    assert max(to @ forward / np.linalg.norm(to) / np.linalg.norm(forward) for to in towards) > 0.9


def test_a_view_looks_as_far_as_the_middle_of_all_is_ahead() -> None:
    """A little ahead where that lies behind the eye."""
    camera = replace(look_at(np.zeros(3), np.array([0.0, 0.0, 1.0]), UP, 160, 120, 50.0), fy=60.0)
    view = describe_view(camera, np.tile([3.0, 0.0, 4.0], (9, 1)))
    assert (*view.target, view.fov) == pytest.approx((0, 0, 4, np.pi / 2))
    behind = np.linspace([-1.0, 0.0, -7.0], [1.0, 0.0, -2.0], 11)
    assert describe_view(camera, behind).target == pytest.approx([0, 0, 0.05 * np.hypot(1.6, 4.0)])


def test_files_of_a_single_tile_have_a_view_too(source: GaussianScene) -> None:
    """Of one tile there is no choice, but of places to look from there is."""
    options = replace(OPTIONS, tile_anchors=4096)
    streaming = read_streaming(Container(BytesSource(encode(source, options))))
    assert streaming.tiles == 1
    assert any(np.allclose(streaming.view.position, camera.centre) for camera in (NEAR_LEFT, NEAR_RIGHT))
    without = read_streaming(Container(BytesSource(encode(source, replace(options, cameras=None)))))
    assert without.view is not None


def test_anchor_files_have_it_too() -> None:
    options = EncodeOptions(quality=36, effort=1, layers=3, corrections=0, cameras=ring(6), only_cameras=True)
    scene = Encoder(measure_scene(small_model(), options)).run().scene
    drawn = reconstruct_anchors(scene)
    block = build_streaming_block(scene, drawn, find_opening_view(drawn, options))
    assert block.tiles == len(scene.tiles)
    assert block.view is not None
