"""PlayCanvas streamed SOG: `lod-meta.json` and the folders beside it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scarfmt.errors import InvalidInput, Unsupported
from scarfmt.formats import detect, load
from scarfmt.formats.source import Source
from tests.formats.scene_files import read_scene, sog_files, zipped
from tests.samples.codec_samples import refuses

BOUND = {"min": [0, 0, 0], "max": [1, 1, 1]}


def put(folder: Path, files: dict[str, bytes]) -> None:
    folder.mkdir(parents=True)
    for name, data in files.items():
        (folder / name).write_bytes(data)


def lod(file: int, offset: int, count: int) -> dict[str, int]:
    return {"file": file, "offset": offset, "count": count}


def index() -> dict[str, Any]:
    """Two files of level 0, one of level 1; three leaves, the last without anything of level 0."""
    leaves = [
        {"bound": BOUND, "lods": {"0": lod(0, 0, 4), "1": lod(2, 0, 2)}},
        {"bound": BOUND, "lods": {"0": lod(1, 0, 5), "1": lod(2, 2, 1)}},
        {"bound": BOUND, "lods": {"1": lod(2, 3, 1)}},
        {"bound": BOUND, "lods": {"0": lod(0, 4, 2)}},
    ]
    tree = {"bound": BOUND, "children": [leaves[0], {"bound": BOUND, "children": leaves[1:]}]}
    names = ["0_0/meta.json", "0_1/meta.json", "1_0/meta.json"]
    return {"version": 1, "count": 15, "counts": [11, 4], "lodLevels": 2, "filenames": names, "tree": tree}


def streamed(folder: Path, changes: dict[str, Any] | None = None) -> Path:
    """A scene in a folder, and the path of its index."""
    for name, count, bands in (("0_0", 6, 1), ("0_1", 5, 1), ("1_0", 4, 1), ("env", 3, 0)):
        put(folder / name, sog_files(count, bands=bands))
    path = folder / "lod-meta.json"
    path.write_text(json.dumps(index() | (changes or {})))
    return path


def test_the_finest_level_is_the_scene(tmp_path: Path) -> None:
    path = streamed(tmp_path)
    assert detect(Source(path)).id == "streamed-sog"
    scene = read_scene(path)
    chunks = [load(zipped(sog_files(count, bands=1))) for count in (6, 5)]
    for name in ("positions", "log_scales", "rotations", "opacity_logits", "sh"):
        np.testing.assert_array_equal(getattr(scene, name), np.concatenate([getattr(c, name) for c in chunks]))
    np.testing.assert_array_equal(read_scene(tmp_path).positions, scene.positions)


def test_the_environment_belongs_to_the_scene(tmp_path: Path) -> None:
    scene = read_scene(streamed(tmp_path, {"environment": "env/meta.json"}))
    sky = read_scene(zipped(sog_files(3, bands=0)))
    assert (len(scene), scene.sh_degree) == (14, 1)
    np.testing.assert_array_equal(scene.positions[11:], sky.positions)
    np.testing.assert_array_equal(scene.sh[11:, 0], sky.sh[:, 0])
    assert not scene.sh[11:, 1:].any()


def test_every_file_of_a_zip_is_read_from_its_own_folder(tmp_path: Path) -> None:
    """All folders hold a `meta.json`: by bare name one of them would stand for all."""
    path = streamed(tmp_path / "scene", {"environment": "env/meta.json", "asset": {"generator": "x"}})
    files = {str(file.relative_to(tmp_path)): file.read_bytes() for file in path.parent.rglob("*") if file.is_file()}
    scene = read_scene(zipped(files))
    np.testing.assert_array_equal(scene.positions, read_scene(path).positions)
    assert len(scene) == 14
    del files["scene/lod-meta.json"]
    refuses("input-format", lambda: load(zipped(files)), "4 scenes")


def test_bundled_chunks_and_environment_are_read(tmp_path: Path) -> None:
    names = ["a.sog", "b.sog", "1_0/meta.json"]
    path = streamed(tmp_path, {"filenames": names, "environment": "environment/environment.sog"})
    (tmp_path / "environment").mkdir()
    for name, count, bands in (("a.sog", 6, 1), ("b.sog", 5, 1), ("environment/environment.sog", 3, 0)):
        (tmp_path / name).write_bytes(zipped(sog_files(count, bands=bands)))
    expected = read_scene(streamed(tmp_path / "folders", {"environment": "env/meta.json"}))
    np.testing.assert_array_equal(read_scene(path).positions, expected.positions)


def test_files_from_before_there_was_a_version_are_read(tmp_path: Path) -> None:
    path = streamed(tmp_path)
    old = {key: value for key, value in index().items() if key not in ("version", "count", "counts")}
    path.write_text(json.dumps(old | {"environment": None}))
    assert len(read_scene(path)) == 11
    path.write_text(json.dumps(index() | {"version": 2}))
    refuses("input-version", lambda: load(path), "streamed SOG version 2", kind=Unsupported)


def test_runs_that_leave_some_out_are_obeyed(tmp_path: Path) -> None:
    leaves = [{"lods": {"0": lod(1, 3, 1)}}, {"lods": {"0": lod(1, 0, 2)}}]
    scene = read_scene(streamed(tmp_path, {"tree": {"children": leaves}}))
    chunk = read_scene(zipped(sog_files(5, bands=1)))
    np.testing.assert_array_equal(scene.positions, chunk.positions[[0, 1, 3]])


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"filenames": ["../0_0/meta.json"] * 3}, "no relative path"),
        ({"filenames": ["/0_0/meta.json"] * 3}, "no relative path"),
        ({"filenames": ["0_0\\meta.json"] * 3}, "no relative path"),
        ({"filenames": ["0_0/means_l.webp"] * 3}, "no relative path"),
        ({"filenames": ["gone/meta.json"] * 3}, "gone"),
        ({"filenames": None}, "list of file names"),
        ({"environment": 3}, "no relative path"),
        ({"tree": None}, "neither children nor levels"),
        ({"tree": {"lods": {"0": lod(3, 0, 1)}}}, "of file 3"),
        ({"tree": {"lods": {"0": lod(0, -1, 1)}}}, "Gaussians -1"),
        ({"tree": {"lods": {"0": lod(0, 0, 7)}}}, "asks for 7 of the 6"),
        ({"tree": {"children": [{"lods": {"0": lod(0, 0, 6)}}] * 9}}, "asks for 54 of the 6"),
        ({"tree": {"lods": {"1": lod(2, 0, 1)}}}, "no leaf of the tree"),
    ],
)
def test_an_index_that_does_not_fit_is_refused(tmp_path: Path, changes: dict[str, Any], said: str) -> None:
    with pytest.raises(InvalidInput, match=said):
        load(streamed(tmp_path, changes))


def test_an_index_without_its_folders_asks_for_them() -> None:
    refuses("input-incomplete", lambda: load(json.dumps(index()).encode()))
