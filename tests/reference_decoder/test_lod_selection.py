"""Layers of tiles for a view: no holes first, then what gains most, and never more Gaussians than the budget."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fuzz.testing.scenes import random_scene
from reference_decoder.decode import DecodeRequest, decode
from reference_decoder.lod_selection import LevelOfDetail, iter_view, select_tiles
from scarfmt.api import decode_view
from scarfmt.coding.writer import write_scene
from scarfmt.container.file import Container
from scarfmt.container.schema import Profile
from scarfmt.container.source import BytesSource
from scarfmt.errors import InvalidInput
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.view_planning import Camera, cubes, meets_picture, tight_boxes

DATA = write_scene(random_scene(11, Profile.EXPLICIT, tiles=9))
ALL = DecodeRequest()


def container() -> Container:
    return Container(BytesSource(DATA)).load()


def camera(away: float) -> Camera:
    """A camera at the middle of the tiles, or `away` diagonals before them; it looks along z."""
    opened = container()
    every = cubes(opened.header.fields, opened.tile_table)
    low, high = every[:, :3].min(axis=0), every[:, 3:].max(axis=0)
    position = (low + high) / 2 - away * float(np.linalg.norm(high - low)) * np.array([0, 0, 1.0])
    return Camera(position, np.array([0, 0, 1.0]), np.array([0, -1.0, 0]), 1.2, 640, 480)


def layers(view: LevelOfDetail, request: DecodeRequest = ALL) -> dict[int, int]:
    """Layers of each tile that gets any."""
    found: dict[int, int] = {}
    for each in select_tiles(BytesSource(DATA), request, view):
        assert each.layers is not None
        found |= dict.fromkeys(each.tiles or (), each.layers)
    return found


def gaussians(levels: dict[int, int]) -> int:
    opened = container()
    return sum(int(opened.tile_counts(k, np.array([tile])).sum()) for tile, k in levels.items())


def test_a_camera_that_sees_all_needs_all() -> None:
    header = container().header
    assert layers(LevelOfDetail(camera(2))) == dict.fromkeys(range(header.tile_count), header.layer_count)
    assert set(layers(LevelOfDetail(camera(2)), replace(ALL, layers=1)).values()) == {1}


def test_tiles_outside_of_the_picture_get_nothing_or_their_first_layer() -> None:
    opened, eye = container(), camera(0)
    seen = meets_picture(tight_boxes(cubes(opened.header.fields, opened.tile_table), None), eye)
    assert 0 < seen.sum() < len(seen)
    assert sorted(layers(LevelOfDetail(eye))) == np.flatnonzero(seen).tolist()
    found = layers(LevelOfDetail(eye, outside=True))
    assert [found[tile] for tile in np.flatnonzero(~seen).tolist()] == [1] * int((~seen).sum())


@pytest.mark.parametrize("share", [0.0, 0.1, 0.3, 0.6, 0.9, 1.0])
def test_budgets_are_kept_and_first_layers_come_first(share: float) -> None:
    """A tile gets a second layer only when no tile lacks a first that would have fit."""
    view = LevelOfDetail(camera(2))
    whole, first = gaussians(layers(view)), gaussians(layers(view, replace(ALL, layers=1)))
    budget = int(share * whole)
    found = layers(replace(view, budget=budget))
    assert gaussians(found) <= budget
    if budget >= first:
        assert len(found) == container().header.tile_count
    if share == 1:
        assert found == layers(view)


def test_near_tiles_get_more_layers_than_far_ones() -> None:
    """By half of all Gaussians, the tiles nearer than the median have more layers in the mean."""
    eye = camera(0.5)
    opened = container()
    every = cubes(opened.header.fields, opened.tile_table)
    away = np.linalg.norm((every[:, :3] + every[:, 3:]) / 2 - eye.position, axis=1)
    view = LevelOfDetail(eye)
    found = layers(replace(view, budget=gaussians(layers(view)) // 2))
    tiles = np.array(sorted(found))
    near = away[tiles] <= np.median(away[tiles])
    numbers = np.array([found[tile] for tile in tiles.tolist()])
    assert numbers[near].mean() >= numbers[~near].mean()


def test_the_values_are_those_of_the_tiles_after_their_layers() -> None:
    view = LevelOfDetail(camera(2), budget=gaussians(layers(LevelOfDetail(camera(2)))) // 2)
    parts = list(iter_view(BytesSource(DATA), ALL, view))
    expected = [decode(DATA, each).scene for each in select_tiles(BytesSource(DATA), ALL, view)]
    found = decode_view(DATA, view)
    assert sum(map(len, parts)) == len(found) == sum(len(scene) for scene in expected)
    assert np.array_equal(found.positions, np.concatenate([_positions(scene) for scene in expected]))
    nothing = decode_view(write_scene(random_scene(1, Profile.EXPLICIT, tiles=2)), replace(view, budget=0))
    assert (len(nothing), nothing.sh_degree) == (0, 3)


def _positions(scene: object) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    assert isinstance(scene, GaussianScene)
    return scene.positions


def test_anchor_models_have_no_view() -> None:
    data = write_scene(random_scene(3, Profile.ANCHOR, tiles=2))
    with pytest.raises(InvalidInput, match="anchor"):
        decode_view(data, LevelOfDetail(camera(2)))
