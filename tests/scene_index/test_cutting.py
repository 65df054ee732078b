"""A scene truncated: every file as it is truncated alone, and an index of them (R-17-12)."""

from __future__ import annotations

from pathlib import Path

import pytest

from scarfmt.container.source import BytesSource
from scarfmt.errors import InvalidInput, Malformed
from scarfmt.scene_index.address import scene_files
from scarfmt.scene_index.cutting import truncate_scene
from scarfmt.scene_index.document import parse_index
from scarfmt.tools.truncate import truncate
from tests.scene_index.scenes import DATA, NAMES, PLACED, scene_folder


@pytest.mark.parametrize("layers", [1, 3, 4])
def test_files_are_cut_as_they_are_alone_and_listed_as_they_are(tmp_path: Path, layers: int) -> None:
    (tmp_path / "whole").mkdir()
    path = scene_folder(tmp_path / "whole", PLACED)
    before = parse_index(path.read_bytes())
    scene = scene_files(path, before)
    target = tmp_path / "cut" / "x.json"
    made = truncate_scene(scene, layers, target)
    assert parse_index(target.read_bytes()) == made
    for name, data, old, new in zip(NAMES, DATA, before.files, made.files, strict=True):
        kept = min(layers, len(old.layers))
        assert (tmp_path / "cut" / name).read_bytes() == truncate(BytesSource(data), kept)
        assert (new.transform, new.low, new.high, new.profile) == (old.transform, old.low, old.high, old.profile)
        assert [layer.gaussians for layer in new.layers] == [layer.gaussians for layer in old.layers[:kept]]
    cut = scene_files(target, made)
    for number in range(2):
        with cut.opened(number):
            pass


def test_nothing_is_overwritten_unasked_and_the_index_comes_last(tmp_path: Path) -> None:
    path = scene_folder(tmp_path)
    scene = scene_files(path, parse_index(path.read_bytes()))
    with pytest.raises(InvalidInput) as caught:
        truncate_scene(scene, 1, path)
    assert caught.value.refusal == "output-exists"
    with pytest.raises(InvalidInput) as caught:
        truncate_scene(scene, 1, tmp_path / "other.json")
    assert caught.value.refusal == "output-exists"
    assert (tmp_path / NAMES[0]).read_bytes() == DATA[0]
    (tmp_path / NAMES[1]).write_bytes(DATA[1][:-1] + b"?")
    (tmp_path / "cut").mkdir()
    with pytest.raises(Malformed):
        truncate_scene(scene, 4, tmp_path / "cut" / "x.json")
    assert not (tmp_path / "cut" / "x.json").exists()


def test_layers_that_no_file_has_are_refused(tmp_path: Path) -> None:
    path = scene_folder(tmp_path)
    scene = scene_files(path, parse_index(path.read_bytes()))
    for layers in (0, 5):
        with pytest.raises(InvalidInput) as caught:
            truncate_scene(scene, layers, tmp_path / "x.json")
        assert caught.value.refusal == "input-layers"
