"""Names of files mean the same whether they are paths or URLs."""

from __future__ import annotations

from pathlib import Path

import fsspec
import pytest

from reference_encoder.scale.places import beside, exists, files_in, is_folder, local_path, version
from scarfmt.errors import InvalidInput


@pytest.mark.parametrize("place", ["{}", "file://{}", "memory://{}"])
def test_folders_and_files_are_found(tmp_path: Path, place: str) -> None:
    root = place.format(tmp_path / "root")
    system, inside = fsspec.core.url_to_fs(root)
    system.makedirs(inside, exist_ok=True)
    for name in ("b", "a"):
        system.pipe(f"{inside}/{name}", name.encode())
    assert is_folder(root)
    assert not is_folder(f"{root}/a")
    assert exists(f"{root}/a")
    assert not exists(f"{root}/c")
    assert [name.rpartition("/")[2] for name in files_in(root)] == ["a", "b"]
    assert all(exists(name) for name in files_in(root))
    assert version(f"{root}/a")["size"] == "1"
    with pytest.raises(InvalidInput) as caught:
        version(f"{root}/c")
    assert caught.value.refusal == "input-source"


def test_a_name_in_a_file_is_beside_that_file() -> None:
    assert beside("/scenes/lod-meta.json", "0_0/meta.json") == "/scenes/0_0/meta.json"
    assert beside("s3://bucket/scene/lod-meta.json", "0_0/meta.json") == "s3://bucket/scene/0_0/meta.json"
    assert local_path("file:///scenes/a.ply") == Path("/scenes/a.ply")
    assert local_path("s3://bucket/a.ply") is None


def test_a_protocol_that_nobody_knows_is_told() -> None:
    with pytest.raises(InvalidInput) as caught:
        exists("nonsense://a/b")
    assert caught.value.refusal == "input-source"
