"""The request decides what is read and how much memory that takes, not the size of the scene."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fuzz.testing.scenes import random_scene
from reference_decoder.request import DecodeRequest
from reference_decoder.scenes.levels import MOST_OPEN
from reference_decoder.scenes.making import Rows, make_index
from reference_decoder.scenes.needs import LevelOfDetail
from reference_decoder.scenes.scene_ply import export_scene_ply
from reference_decoder.scenes.scene_set import SceneSet, open_scene
from scarfmt.coding.writer import write_scene
from scarfmt.counters import Counters
from scarfmt.streaming.view import Camera

TILES, ANCHORS = 16, 1600
FILE = write_scene(random_scene(8, anchors=ANCHORS, tiles=TILES, layers=4, sh_degree=2))
APART = 4.0
"""Between two files along x; each is a cube of side 1."""
FEW, MANY = MOST_OPEN, 3 * MOST_OPEN
CORNER = (-1.5, 0.25, 3.0)
SLACK = 96 << 10
"""For the index itself, which has 0.6 kB a file, and for what interpreters keep."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Scenes of few and of many files, side by side."""
    made = tmp_path_factory.mktemp("large")
    paths = [made / f"{number}.scar" for number in range(MANY)]
    for path in paths:
        path.write_bytes(FILE)
    for name, count in (("few", FEW), ("many", MANY)):
        placed = {path.name: _moved(APART * number) for number, path in enumerate(paths[:count])}
        (made / f"{name}.json").write_bytes(make_index(paths[:count], made, placed).text())
    return made


def _moved(x: float) -> Rows:
    return [[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]


Work = Callable[[SceneSet, Counters], int]


def spent(path: Path, work: Work) -> tuple[int, int, int]:
    """The result of `work`, the bytes read, and the peak of the memory that Python and NumPy allocated."""
    counters = Counters()
    with open_scene(path) as scene:
        tracemalloc.start()
        try:
            found = work(scene, counters)
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
    return found, counters.bytes_read, peak


def _region(scene: SceneSet, counters: Counters) -> int:
    low = np.array(CORNER)
    box = low.tolist(), (low + 0.5).tolist()
    parts = scene.iter_tiles(layers=2, box=box, counters=counters, threads=1)
    return sum(len(part.scene) for part in parts)


def _seen(scene: SceneSet, counters: Counters) -> int:
    """From above, so near that one file fills the picture."""
    eye = Camera(np.add(CORNER, [0.5, 0.5, -1.0]), np.array([0, 0, 1.0]), np.array([0, -1.0, 0]), 0.8, 64, 64)
    parts = scene.iter_tiles(DecodeRequest(threads=1), LevelOfDetail(eye, 2000), order="camera", counters=counters)
    return sum(len(part.scene) for part in parts)


@pytest.mark.parametrize("work", [_region, _seen])
def test_what_is_not_asked_for_costs_nothing(folder: Path, work: Work) -> None:
    few, many = (spent(folder / f"{name}.json", work) for name in ("few", "many"))
    assert few[0] > 0
    assert many[:2] == few[:2]
    assert many[2] < 1.05 * few[2] + SLACK


def test_a_region_of_a_file_reads_its_tiles_alone(folder: Path) -> None:
    """Some of its tiles, two of four layers: the front and the models are most of what is read."""
    _, read, _ = spent(folder / "few.json", _region)
    with open_scene(folder / "few.json") as scene:
        layers = scene.index.files[0].layers
    assert read < 0.8 * layers[1].end


def _each(scene: SceneSet, counters: Counters) -> int:
    return sum(len(part.scene) for part in scene.iter_tiles(counters=counters, threads=1))


def _by_need(scene: SceneSet, counters: Counters) -> int:
    eye = Camera(np.array([40.0, 0, -90]), np.array([0, 0, 1.0]), np.array([0, -1.0, 0]), 1.4, 64, 64)
    parts = scene.iter_tiles(DecodeRequest(threads=1), LevelOfDetail(eye), order="camera", counters=counters)
    return sum(len(part.scene) for part in parts)


@pytest.mark.parametrize("work", [_each, _by_need])
def test_all_of_a_larger_scene_takes_no_more_memory(folder: Path, work: Work) -> None:
    """By need, what is known of tiles grows with them: some 300 bytes each; their Gaussians do not stay."""
    few, many = (spent(folder / f"{name}.json", work) for name in ("few", "many"))
    tiles = TILES * (MANY - FEW)
    assert (few[0], many[0]) == (ANCHORS * FEW, ANCHORS * MANY)
    assert many[1] > 0.9 * MANY / FEW * few[1]
    assert many[2] < 1.25 * few[2] + SLACK + 600 * tiles


def test_a_ply_is_written_as_it_is_decoded(folder: Path, tmp_path: Path) -> None:
    def work(scene: SceneSet, counters: Counters) -> int:
        target = tmp_path / f"{len(scene.files)}.ply"
        return export_scene_ply(scene, target, DecodeRequest(threads=1), counters=counters)

    few, many = (spent(folder / f"{name}.json", work) for name in ("few", "many"))
    assert (few[0], many[0]) == (ANCHORS * FEW, ANCHORS * MANY)
    assert many[2] < 1.05 * few[2] + SLACK
