"""A scene checked: each file, that it is the one listed, and that it is where the index says."""

from __future__ import annotations

import json
from pathlib import Path

from reference_decoder.scenes.checking import SceneValidation, validate_scene
from reference_decoder.scenes.scene_set import open_scene
from tests.scene_index.scenes import DATA, NAMES, PLACED, scene_folder


def checked(path: Path) -> SceneValidation:
    return validate_scene(open_scene(path))


def test_a_sound_scene_is_valid(tmp_path: Path) -> None:
    found = checked(scene_folder(tmp_path, PLACED))
    assert found.valid
    assert list(found.files) == list(NAMES)
    assert found.files[NAMES[1]].layers_readable == 4


def test_anchors_outside_of_the_box_are_found(tmp_path: Path) -> None:
    """R-17-9: what no reader of a region would find."""
    path = scene_folder(tmp_path)
    document = json.loads(path.read_bytes())
    document["files"][0]["box"][1][0] = document["files"][0]["box"][0][0] + 0.3
    path.write_text(json.dumps(document))
    found = checked(path)
    assert [(one.refusal, one.field) for one in found.findings] == [("scene-file", NAMES[0])]
    assert not found.valid


def test_all_files_are_looked_at_whatever_is_wrong_with_one(tmp_path: Path) -> None:
    path = scene_folder(tmp_path)
    (tmp_path / NAMES[0]).write_bytes(DATA[1])
    (tmp_path / NAMES[1]).write_bytes(DATA[1][:-3] + b"???")
    found = checked(path)
    assert [one.refusal for one in found.findings] == ["scene-file"]
    assert not found.files[NAMES[1]].valid
    assert found.as_json()["files"][0]["findings"][0]["refusal"] == "crc-mismatch"
    (tmp_path / NAMES[0]).unlink()
    assert [one.refusal for one in checked(path).findings] == ["input-source"]
