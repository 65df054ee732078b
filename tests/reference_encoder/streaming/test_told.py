"""The STREAMING block of a file: larger gains where more is seen, boxes around what is there, and the scene is
unchanged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from reference_decoder.decode import decode
from reference_encoder.encode import EncodeOptions, encode
from reference_encoder.judge.finished import finished_gaussians
from reference_encoder.pipeline import quantised
from reference_encoder.streaming.told import told, usual_viewpoints
from scarfmt.blocks.streaming import read_streaming
from scarfmt.coding.writer import QuantisedScene, keep_layers, write_scene
from scarfmt.container.directory import tile_table
from scarfmt.container.file import Container
from scarfmt.container.source import BytesSource
from scarfmt.errors import InvalidInput
from scarfmt.render.camera import look_at
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.streaming.boxes import cubes, tight_boxes
from scarfmt.tools.inspection import inspect
from scarfmt.tools.truncate import truncate
from tests.reference_encoder.profiles.test_anchors import ring, small_model

UP = np.array([0.0, 1.0, 0.0])
NEAR_LEFT, NEAR_RIGHT = (
    look_at(np.array([x, 0.0, 3.0]), np.array([x, 0.0, 0.0]), UP, 160, 120, 50.0) for x in (-6.0, 6.0)
)
OPTIONS = EncodeOptions(
    effort=1, layers=3, quality=38, corrections=0, tile_anchors=1024, cameras=[NEAR_LEFT, NEAR_RIGHT], decode_budget=0
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
    return quantised(source, OPTIONS).scene


def middles(scene: QuantisedScene) -> np.ndarray:
    """Mean place of each tile's Gaussians."""
    places = finished_gaussians(scene).positions
    edges = np.cumsum([len(content) for content in scene.contents])[:-1]
    return np.array([part.mean(axis=0) for part in np.split(places, edges)])


def test_what_is_seen_from_a_viewpoint_gains_there(scene: QuantisedScene) -> None:
    """Each tile gains more where it is in front than from where no view has it in its picture; but something there."""
    streaming = told(scene, replace(OPTIONS, only_cameras=True), 2)
    x = middles(scene)[:, 0]
    assert len(x) >= 2
    assert len(streaming.viewpoints) == 2
    first, left = streaming.gains[:, 0], int(streaming.viewpoints[:, 0].argmin())
    assert (np.where(x < 0, first[left], first[1 - left]) > np.where(x < 0, first[1 - left], first[left])).all()
    assert (first > 0).all()


def test_later_layers_gain_less_than_the_first(scene: QuantisedScene) -> None:
    """All tiles together, in squared error."""
    streaming = told(scene, OPTIONS, 4)
    errors = np.exp2((streaming.gains.astype(float) - 255) / 4).sum(axis=(0, 2))
    assert errors[0] > 2 * errors[1:].max()


def test_boxes_hold_what_is_there_and_hardly_more(scene: QuantisedScene) -> None:
    """Every Gaussian's place, to a step of 1/256 of the tile; reaches are of the size of splats."""
    streaming = told(scene, OPTIONS, 1)
    every = cubes(scene.fields, tile_table(scene.tiles))
    boxes = tight_boxes(every, replace(streaming, reach=np.zeros_like(streaming.reach)))
    out = tight_boxes(every, streaming).high - boxes.high
    edges = np.cumsum([len(content) for content in scene.contents])[:-1]
    for number, places in enumerate(np.split(finished_gaussians(scene).positions, edges)):
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


def test_the_view_to_begin_with_is_a_camera_that_looks_at_the_scene(scene: QuantisedScene) -> None:
    """It is one of the given cameras; without cameras it looks from outside towards the middle."""
    given = told(scene, OPTIONS, 1).view
    assert given is not None
    assert np.abs(given.position).tolist() == [6.0, 0.0, 3.0]
    assert given.up @ UP == pytest.approx(1)
    assert given.fov == pytest.approx(2 * np.arctan(60 / NEAR_LEFT.fy))
    free = told(scene, replace(OPTIONS, cameras=None), 1).view
    assert free is not None
    assert np.linalg.norm(free.target) < 7
    assert np.linalg.norm(free.position) > 8


def test_the_encoder_tells_it_and_the_scene_stays(source: GaussianScene) -> None:
    """The block has the requested number of viewpoints; truncation stays an identity; 0 leaves the block out."""
    whole, without = (encode(source, replace(OPTIONS, viewpoints=count)) for count in (2, 0))
    streaming = read_streaming(Container.open(BytesSource(whole)))
    assert streaming is not None
    assert len(streaming.viewpoints) == 2
    assert read_streaming(Container.open(BytesSource(without))) is None
    mine, other = decode(whole).scene, decode(without).scene
    assert isinstance(mine, GaussianScene)
    assert isinstance(other, GaussianScene)
    assert np.array_equal(mine.positions, other.positions)
    assert np.array_equal(mine.sh, other.sh)
    plain = replace(
        quantised(source, OPTIONS).scene,
        metadata=inspect(BytesSource(whole), metadata=True)["metadata"],
        streaming=streaming,
    )
    for kept in range(1, len(plain.model.layers) + 1):
        assert truncate(BytesSource(whole), kept) == write_scene(keep_layers(plain, kept))


def test_a_single_tile_is_told_where_to_begin_if_cameras_are_known(source: GaussianScene) -> None:
    """Else a viewer would show what was photographed from within from outside. A choice there is none."""
    options = replace(OPTIONS, tile_anchors=4096)
    streaming = read_streaming(Container.open(BytesSource(encode(source, options))))
    assert streaming is not None
    assert (streaming.tiles, streaming.gains.shape) == (1, (0, 3, 1))
    assert streaming.view is not None
    assert any(np.allclose(streaming.view.position, camera.centre) for camera in (NEAR_LEFT, NEAR_RIGHT))
    for silent in (replace(options, viewpoints=0), replace(options, cameras=None)):
        assert read_streaming(Container.open(BytesSource(encode(source, silent)))) is None


def test_how_many_viewpoints_unless_somebody_says(scene: QuantisedScene) -> None:
    """A two-hundredth of the file, at most 8, at least 4; none where there is nothing to choose."""
    numbers = len(scene.tiles) * len(scene.model.layers)
    assert usual_viewpoints(scene, 200 * numbers * 5 + 1) == 5
    assert usual_viewpoints(scene, 1 << 40) == 8
    assert usual_viewpoints(scene, 10) == 4
    assert usual_viewpoints(replace(scene, tiles=scene.tiles[:1], contents=scene.contents[:1]), 1 << 40) == 0


@pytest.mark.parametrize("count", [-1, 65])
def test_impossible_numbers_of_viewpoints_are_refused(count: int) -> None:
    with pytest.raises(InvalidInput) as caught:
        EncodeOptions(viewpoints=count).check()
    assert caught.value.field == "viewpoints"


def test_anchors_are_told_of_too() -> None:
    """Gains of every layer, from networks looked at through the eyes."""
    options = EncodeOptions(
        quality=36, effort=1, layers=3, corrections=0, cameras=ring(6), only_cameras=True, decode_budget=0
    )
    scene = quantised(small_model(), options).scene
    streaming = told(scene, options, 3)
    assert streaming.gains.shape == (3, len(scene.model.layers), len(scene.tiles))
    errors = np.exp2((streaming.gains.astype(float) - 255) / 4).sum(axis=(0, 2))
    assert errors[0] > errors[1:].max()
    assert (streaming.gains > 0).mean() > 0.9
