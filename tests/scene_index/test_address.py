"""The addresses of the files of an index; nothing else is opened for it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from fuzz.testing.scenes import random_scene
from scarfmt.coding.writer import write_scene
from scarfmt.container.source import ByteSource, BytesSource
from scarfmt.errors import InvalidInput, Malformed
from scarfmt.scene_index.address import SceneFiles, beside, scene_files, uri_of
from scarfmt.scene_index.document import parse_index
from tests.scene_index.scenes import DATA, made, scene_folder


def test_files_lie_beside_the_index_or_below(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert beside(tmp_path / "a" / "i.json", "b/c.scar") == str(tmp_path / "a" / "b" / "c.scar")
    assert beside("i.json", "-") == str(tmp_path / "-")
    address = "https://x.org/deep/i.json?token=1#part"
    assert beside(address, "b/c d#.scar".replace("#", "ä")) == "https://x.org/deep/b/c%20d%C3%A4.scar"
    assert beside("https://x.org", "c.scar") == "https://x.org/c.scar"
    assert beside("s3://bucket/deep/i.json", "c d.scar") == "s3://bucket/deep/c d.scar"


def test_an_index_names_no_file_outside_of_its_folder(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    assert uri_of(tmp_path / "in" / "a.scar", tmp_path) == "in/a.scar"
    with pytest.raises(InvalidInput) as caught:
        uri_of(tmp_path / "a.scar", tmp_path / "in")
    assert caught.value.refusal == "input-scene"


def test_only_listed_files_are_opened_and_only_when_needed(tmp_path: Path) -> None:
    """R-17-7: with everything else an index may hold, nothing but its files is asked for."""
    path = scene_folder(tmp_path)
    asked: list[str] = []

    def opener(place: str) -> ByteSource:
        asked.append(place)
        return BytesSource(Path(place).read_bytes())

    scene = scene_files(str(path), parse_index(path.read_bytes()), opener=opener)
    assert asked == []
    with scene.opened(1):
        assert asked == [str(tmp_path / "deep" / "b.scar")]


def test_an_index_without_a_place_has_no_files() -> None:
    for origin in ("-", b"{}"):
        with pytest.raises(InvalidInput) as caught:
            scene_files(origin, made())
        assert caught.value.refusal == "input-scene"


@pytest.mark.parametrize(
    ("name", "value"),
    [("length", 7), ("header_crc32", 7), ("sh_degree", 3), ("slots", 2), ("layers", None), ("coordinate_frame", None)],
)
def test_another_file_than_the_one_listed_is_refused(name: str, value: int | None) -> None:
    """R-17-8: each number that the index repeats."""
    data = made().text()
    document = json.loads(data)
    if name == "coordinate_frame":
        document[name] = "RUB"
    elif name == "layers":
        document["files"][0][name] = document["files"][0][name][1:]
    elif name == "length":
        document["files"][0][name] += value
        document["files"][0]["layers"][-1]["end"] += value
    else:
        document["files"][0][name] = value
    index = parse_index(json.dumps(document).encode())
    scene = SceneFiles(index, lambda _: BytesSource(DATA[0]))
    with pytest.raises(Malformed) as caught, scene.opened(0):
        pass
    assert (caught.value.refusal, caught.value.field) == ("scene-file", name)
    assert "a.scar" in caught.value.message


def test_a_file_that_breaks_a_rule_is_refused_as_it_is_alone() -> None:
    damaged = bytearray(write_scene(random_scene(1)))
    damaged[40] ^= 1
    scene = SceneFiles(made(), lambda _: BytesSource(bytes(damaged)))
    with pytest.raises(Malformed) as caught, scene.opened(0):
        pass
    assert caught.value.refusal == "header-crc-mismatch"
