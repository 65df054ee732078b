"""Scenes of several files read as one: by layers, by region, for a view; the same numbers as each file gives."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from reference_decoder.decode import decode
from reference_decoder.request import DecodeRequest
from reference_decoder.scenes.needs import LevelOfDetail, placed_back
from reference_decoder.scenes.scene_ply import export_scene_ply
from reference_decoder.scenes.scene_set import SceneSet, open_scene
from reference_decoder.scenes.stream_scene import placed_views
from reference_decoder.stream_ply import Baking, export_ply
from scarfmt.coding.reader import SceneReader
from scarfmt.container.source import BytesSource
from scarfmt.counters import Counters
from scarfmt.errors import InvalidInput, LimitExceeded, Malformed, ScarError
from scarfmt.formats import load
from scarfmt.formats.joined import widened
from scarfmt.limits import Limits
from scarfmt.render.camera import look_at
from scarfmt.scene.gaussians import AnchorModel, GaussianScene
from scarfmt.scene.placement import Placement
from scarfmt.streaming.view import Camera
from tests.scene_index.scenes import ANCHORS, DATA, NAMES, PLACED, scene_folder

PLACEMENT = Placement.of(PLACED)
AWAY = Camera(np.array([4.0, 0, -30]), np.array([0, 0, 1.0]), np.array([0, -1.0, 0]), 1.2, 640, 480)
"""A camera that has both files in the picture."""


@pytest.fixture
def scene(tmp_path: Path) -> SceneSet:
    return open_scene(scene_folder(tmp_path, PLACED))


def gaussians(data: bytes, **fields: Any) -> GaussianScene:
    found = decode(data, **fields).scene
    assert isinstance(found, GaussianScene)
    return found


def expected(layers: int | None = None) -> list[GaussianScene]:
    """The content of each file, the second one placed."""
    first = gaussians(DATA[0], layers=None if layers is None else min(layers, 3))
    return [first, PLACEMENT.scene(gaussians(DATA[1], layers=layers))]


def same(found: GaussianScene, parts: list[GaussianScene]) -> bool:
    coefficients = found.sh.shape[1]
    wide = [replace(part, sh=widened(part.sh, coefficients)) for part in parts]
    joined = {name: np.concatenate([getattr(part, name) for part in wide]) for name in vars(found)}
    # Networks may round otherwise where other rows are computed with these.
    near = all(np.allclose(getattr(found, name), joined[name], rtol=1e-5, atol=1e-5) for name in joined)
    return near and np.array_equal(found.positions, joined["positions"])


@pytest.mark.parametrize("layers", [None, 1, 3, 4])
def test_all_of_a_scene_is_all_of_its_files(scene: SceneSet, layers: int | None) -> None:
    """A file that has fewer layers gives all it has; degrees that it lacks are zeros (R-17-10)."""
    assert same(scene.decode(layers=layers), expected(layers))
    counted = scene.layers[-1 if layers is None else layers - 1].gaussians
    assert sum(len(part.scene) for part in scene.iter_tiles(layers=layers)) == counted


def test_a_region_is_in_the_coordinates_of_the_scene(scene: SceneSet) -> None:
    """Exactly the Gaussians whose placed centres are in the box."""
    whole = scene.decode()
    middle = np.median(expected()[1].positions, axis=0)
    box = (middle - 0.8).tolist(), (middle + 0.8).tolist()
    inside = ((whole.positions >= box[0]) & (whole.positions <= box[1])).all(axis=1)
    assert 0 < inside.sum() < len(inside)
    assert same(scene.decode(box=box), [whole.take(inside)])
    detail = LevelOfDetail(AWAY)
    found = scene.decode(DecodeRequest(box=box), detail)
    assert sorted(map(tuple, found.positions)) == sorted(map(tuple, whole.positions[inside]))


def test_what_all_files_hold_together_is_what_is_held_at_once(tmp_path: Path) -> None:
    """No file is too large alone; in parts, of fewer layers or of a region the scene can be had (R-13.2-3)."""
    path = scene_folder(tmp_path, PLACED)
    scene, number = open_scene(path), sum(len(gaussians(data)) for data in DATA)
    assert max(len(gaussians(data)) for data in DATA) < number - 1
    few, enough = Limits(gathered=number - 1), Limits(gathered=number)
    assert len(scene.decode(limits=enough)) == number
    everywhere = ((-1e3,) * 3, (1e3,) * 3)
    for fields in ({}, {"box": everywhere}, {"view": LevelOfDetail(AWAY)}):
        with pytest.raises(LimitExceeded, match="tile by tile") as caught:
            scene.decode(limits=few, **fields)
        assert caught.value.refusal == "limit-gathered"
        assert len(scene.decode(limits=enough, **fields)) == number
    assert len(scene.decode(limits=few, layers=1)) < number
    assert sum(len(part.scene) for part in scene.iter_tiles(limits=few)) == number
    for name in NAMES:
        (tmp_path / name).unlink()
    with pytest.raises(LimitExceeded):
        open_scene(path).decode(limits=few)


def test_files_out_of_the_region_are_not_opened(tmp_path: Path) -> None:
    path = scene_folder(tmp_path, PLACED)
    (tmp_path / NAMES[1]).unlink()
    scene, box = open_scene(path), ((-2.0, 0.0, 3.0), (0.0, 2.0, 4.0))
    assert same(scene.decode(box=box), [gaussians(DATA[0], box=box)])
    near = LevelOfDetail(Camera(np.array([-1.0, 0.75, 0]), np.array([0, 0, 1.0]), np.array([0, -1.0, 0]), 0.5, 9, 9))
    assert len(scene.decode(None, near))
    with pytest.raises(InvalidInput) as caught:
        scene.decode()
    assert caught.value.refusal == "input-source"
    assert NAMES[1] in str(caught.value)


def test_a_view_without_a_budget_has_all_that_is_in_the_picture(scene: SceneSet) -> None:
    found = scene.decode(None, LevelOfDetail(AWAY))
    whole = scene.decode()
    assert sorted(map(tuple, found.positions)) == sorted(map(tuple, whole.positions))
    assert len(scene.decode(DecodeRequest(layers=1), LevelOfDetail(AWAY))) == scene.layers[0].gaussians


@pytest.mark.parametrize("budget", [40, 200, 450])
def test_tiles_of_a_view_are_those_of_their_layers(scene: SceneSet, budget: int) -> None:
    """Within the budget, each tile is what its file gives after so many layers; in either order the same ones."""
    detail, orders = LevelOfDetail(AWAY, budget), {}
    for order in ("file", "camera"):
        parts = list(scene.iter_tiles(None, detail, order=order))
        orders[order] = [(part.file, part.tile, part.layers) for part in parts]
        assert sum(len(part.scene) for part in parts) <= budget
        for part in parts:
            alone = gaussians(DATA[part.file], tiles=[part.tile], layers=part.layers)
            wanted = alone if part.file == 0 else PLACEMENT.scene(alone)
            assert isinstance(part.scene, GaussianScene)
            assert same(part.scene, [wanted])
    assert sorted(orders["file"]) == sorted(orders["camera"])
    needed = [(need.file, need.tile, need.layers) for need in scene.needs(detail, DecodeRequest())]
    assert [one for one in needed if one in orders["camera"]] == orders["camera"]
    assert orders["file"] == sorted(orders["file"], key=lambda one: (one[0], one[2], one[1]))


def test_a_placed_file_is_seen_as_it_is_alone(scene: SceneSet) -> None:
    """The needs of a camera do not depend on where everything, camera and file, is placed."""
    alone = open_scene(DATA[1])
    there = Camera(np.array([-1.2, 0.7, 1.0]), np.array([0.1, 0, 1.0]), np.array([0, -1.0, 0]), 0.6, 640, 480)
    moved = Camera(
        PLACEMENT.points(there.position[None])[0],
        there.forward @ PLACEMENT.rotation.T,
        there.up @ PLACEMENT.rotation.T,
        0.6,
        640,
        480,
    )
    back = placed_back(moved, PLACEMENT)
    np.testing.assert_allclose(back.position, there.position, atol=1e-12)
    mine = [need[1:] for need in alone.needs(LevelOfDetail(there), DecodeRequest())]
    placed = [need[1:] for need in scene.needs(LevelOfDetail(moved), DecodeRequest()) if need.file == 1]
    assert mine
    assert placed == mine


def test_a_single_file_is_a_scene(tmp_path: Path) -> None:
    path = tmp_path / "one.scar"
    path.write_bytes(DATA[0])
    for origin in (path, DATA[0], BytesSource(DATA[0])):
        with open_scene(origin) as scene:
            assert same(scene.decode(tiles=[1, 0]), [gaussians(DATA[0], tiles=[1, 0])])
            low, high = scene.boxes
            positions = gaussians(DATA[0]).positions
            assert ((positions >= low[0]) & (positions <= high[0])).all()


def test_requests_that_do_not_fit_are_refused(scene: SceneSet) -> None:
    wrong: list[tuple[str, dict[str, Any]]] = [
        ("input-tiles", {"tiles": [0]}),
        ("input-layers", {"layers": 5}),
        ("input-layers", {"layers": 0}),
        ("input-scene", {"order": "camera"}),
        ("input-scene", {"order": "size", "view": LevelOfDetail(AWAY)}),
    ]
    for refusal, arguments in wrong:
        with pytest.raises(InvalidInput) as caught:
            list(scene.iter_tiles(**arguments))
        assert caught.value.refusal == refusal


def test_damage_says_in_which_file(tmp_path: Path) -> None:
    path = scene_folder(tmp_path)
    (tmp_path / NAMES[1]).write_bytes(DATA[1][:-3] + b"???")
    scene = open_scene(path)
    for view in (None, LevelOfDetail(AWAY)):
        with pytest.raises(Malformed) as caught:
            scene.decode(None, view)
        assert caught.value.message.count(NAMES[1]) == 1


def test_an_anchor_model_stays_in_its_own_coordinates(tmp_path: Path) -> None:
    """The networks of a placed file look from the camera in the file's coordinates (R-17-11)."""
    scene = open_scene(_with_anchors(tmp_path))
    parts = [part for part in scene.iter_tiles() if part.file == 1]
    whole = decode(ANCHORS).scene
    assert isinstance(whole, AnchorModel)
    assert all(part.placement is not None and isinstance(part.scene, AnchorModel) for part in parts)
    assert sum(len(part.scene) for part in parts) == len(whole)
    with pytest.raises(InvalidInput) as caught:
        scene.decode()
    assert caught.value.refusal == "input-scene"


def _with_anchors(folder: Path) -> Path:
    from reference_decoder.scenes.making import make_index

    paths = [folder / "a.scar", folder / "anchors.scar"]
    for path, data in zip(paths, (DATA[1], ANCHORS), strict=True):
        path.write_bytes(data)
    (folder / "i.json").write_bytes(make_index(paths, folder, {"anchors.scar": PLACED}).text())
    return folder / "i.json"


@pytest.mark.parametrize("view", [None, LevelOfDetail(AWAY, 300)])
def test_the_ply_of_a_scene_is_that_of_its_gaussians(scene: SceneSet, view: LevelOfDetail | None) -> None:
    target = io.BytesIO()
    count = export_scene_ply(scene, target, DecodeRequest(), view)
    found, wanted = load(target.getvalue()), scene.decode(None, view)
    assert isinstance(found, GaussianScene)
    assert count == len(found) == len(wanted)
    assert np.array_equal(found.positions, wanted.positions.astype(np.float32))
    assert np.array_equal(found.sh, wanted.sh)


def test_a_file_alone_is_written_as_always(tmp_path: Path) -> None:
    always, now = io.BytesIO(), io.BytesIO()
    for request in (DecodeRequest(), DecodeRequest(layers=2, tiles=[3, 1]), DecodeRequest(box=((-2, 0, 3), (0, 1, 4)))):
        export_ply(DATA[0], always, request)
        export_scene_ply(open_scene(DATA[0]), now, request)
        assert now.getvalue() == always.getvalue()


def test_anchors_are_baked_where_they_are_and_placed_then(tmp_path: Path) -> None:
    """Seen by the same camera of the scene, they are what the file alone gives a camera of its own."""
    scene = open_scene(_with_anchors(tmp_path))
    view = look_at(np.array([8.0, 0, -20]), np.array([9.0, -1, 9]), np.array([0, -1.0, 0]), 64, 48, 60.0)
    target, alone = io.BytesIO(), io.BytesIO()
    with pytest.raises(InvalidInput):
        export_scene_ply(scene, target, DecodeRequest())
    export_scene_ply(scene, target, DecodeRequest(), baking=Baking([view], 0, 1))
    here = placed_views([view], PLACEMENT)
    np.testing.assert_allclose(here[0].centre, PLACEMENT.points_back(view.centre[None])[0], atol=1e-9)
    export_ply(ANCHORS, alone, baking=Baking(here, 0, 2))
    found, model = load(target.getvalue()), load(alone.getvalue())
    assert isinstance(found, GaussianScene)
    assert isinstance(model, GaussianScene)
    rest = found.take(np.arange(len(gaussians(DATA[1])), len(found)))
    np.testing.assert_allclose(rest.positions, PLACEMENT.points(model.positions), atol=1e-4)
    np.testing.assert_allclose(rest.log_scales, model.log_scales + np.log(3), atol=1e-5)


def test_what_is_read_is_counted(scene: SceneSet) -> None:
    counters, one = Counters(), Counters()
    scene.decode(counters=counters)
    scene.decode(None, LevelOfDetail(AWAY, 100), counters=one)
    # Each file once, and its header once more: is it the one that is listed?
    headers = sum(104 + 136 * layers for layers in (3, 4))
    assert sum(map(len, DATA)) + headers <= counters.bytes_read < 1.2 * sum(map(len, DATA)) + 5000
    assert counters.anchors == sum(map(len, expected()))
    assert one.bytes_read > 0
    assert 0 < one.anchors <= 100
    nothing = Counters()
    assert len(scene.decode(box=((99, 99, 99), (100, 100, 100)), counters=nothing)) == 0
    assert (nothing.bytes_read, nothing.reads) == (0, 0)


def test_a_reader_beside_another_decodes_other_layers() -> None:
    """Each reader keeps what it prepared for its own number of layers."""
    reader = SceneReader(BytesSource(DATA[1]))
    twin = reader.twin()
    models, fewer = reader.models(), twin.models(1)
    first = [len(content) for _, content in twin.tiles(fewer)]
    assert [len(content) for _, content in reader.tiles(models)] >= first
    assert [len(content) for _, content in twin.tiles(fewer)] == first


def test_errors_are_those_of_the_package(tmp_path: Path) -> None:
    with pytest.raises(ScarError):
        open_scene(b"{}")
