"""Choosing the importer."""

from __future__ import annotations

import gzip
import json
import os
import threading
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from scarfmt.errors import InvalidInput, ScarError
from scarfmt.formats import FORMATS, detect, load
from scarfmt.formats.source import Source
from tests.formats.scene_files import (
    EXAMPLES,
    compressed_ply,
    gltf_document,
    inria_ply,
    read_scene,
    sog_files,
    spz,
    zipped,
)
from tests.samples.codec_samples import refuses
from tests.samples.equality import same

MARKED = {name: data for name, data in EXAMPLES.items() if name != "splat"}


@pytest.mark.parametrize("name", MARKED)
def test_content_decides_over_a_wrong_file_name(name: str, tmp_path: Path) -> None:
    path = tmp_path / "scene.splat"
    path.write_bytes(MARKED[name])
    assert detect(Source(path)).id == name.split()[0]


@pytest.mark.parametrize("known", [known.id for known in FORMATS])
def test_a_wrong_format_by_name_ends_in_a_refusal_at_most(known: str, tmp_path: Path) -> None:
    for data in (b"{", b"[]", b"{}", bytes(4096), *EXAMPLES.values()):
        (tmp_path / "scene").write_bytes(data)
        with suppress(ScarError):
            load(tmp_path / "scene", format=known)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="POSIX pipes")
@pytest.mark.parametrize("name", ["ply", "sog", "spz v4"])
def test_a_pipe_is_read_once_and_by_its_content(name: str, tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    writer = threading.Thread(target=pipe.write_bytes, args=(EXAMPLES[name],))
    writer.start()
    assert len(load(pipe)) == len(load(EXAMPLES[name]))
    writer.join()


def test_file_name_decides_where_content_has_no_mark(tmp_path: Path) -> None:
    path = tmp_path / "Scene.SPLAT"
    path.write_bytes(EXAMPLES["splat"])
    assert len(load(path)) == 4


@pytest.mark.parametrize("name", EXAMPLES)
def test_bytes_and_path_give_the_same_scene(name: str, tmp_path: Path) -> None:
    path = tmp_path / "scene"
    path.write_bytes(EXAMPLES[name])
    known = name.split()[0]
    from_path, from_bytes = load(path, format=known), load(EXAMPLES[name], format=known)
    assert same(from_path, from_bytes)
    assert len(from_path) > 0


@pytest.mark.parametrize(
    "data",
    [
        *(inria_ply(0, 9), inria_ply(0, 0), compressed_ply(0, rest=9), zipped(sog_files(0))),
        *(spz(version, 0) for version in (1, 2, 3, 4)),
    ],
    ids=range(8),
)
def test_an_empty_scene_is_read_as_empty(data: bytes) -> None:
    assert len(load(data)) == 0


@pytest.mark.parametrize("given", [b"hello, this is no scene", b"\x00" * 64, b"{}"])
def test_unknown_content_is_refused_with_the_list_of_formats(given: bytes) -> None:
    refuses("input-format", lambda: load(given), ".*".join(known.id for known in FORMATS))


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (b"", "an empty file"),
        (b"<!DOCTYPE html><html>", "a web page"),
        (b"version https://git-lfs.github.com/spec/v1\n", "git lfs pull"),
        (b"x" * 257 + b"ustar\x0000", "a tar archive"),
        (b"\xfd7zXZ\0", "packed by xz"),
        (b"BZh91AY", "packed by bzip2"),
        (b"\x28\xb5\x2f\xfd", "packed by zstd"),
        (b"# .PCD v0.7", "a PCD point cloud"),
        (b"spx\x01", "gsbox"),
        (b"Kg\0\0\x10\0\0\0", "a moving scene"),
        (b"\x80\x02\x8a\nl", "an old checkpoint"),
        (b"RIFF\0\0\0\0WEBP", "its meta.json"),
        (b'{"means": {"shape": [4, 3]}, "opacities": {}}', "PngCompression"),
        (b"b3dm", "a tile of meshes"),
        (zipped({}), "an empty ZIP"),
        (b'{"asset": {"version": "1.1"}, "geometricError": 1, "root": {}}', "a tileset of 3D Tiles"),
        (b'{"version": "5.0", "totalSplats": 4, "attributes": []}', "a scene of XGRIDS"),
        (b'{"totalLevels": 2, "totalSplats": 4, "lodSplats": [4, 2], "root": {}}', "a scene of XGRIDS"),
        (b'{"frames": []}', "a list of cameras"),
        (b"RADC\0\0\0\0", "the .rad beside it"),
        (zipped({"archive/data.pkl": b""}), "checkpoint of PyTorch"),
        (zipped({"positions.npy": b"", "sh.npy": b""}), "arrays of NumPy"),
        (zipped({"readme.txt": b"hello"}), "no scene in it: readme.txt"),
        (zipped({"a.ply": b"", "b.ply": b""}), "2 scenes, a.ply, b.ply"),
    ],
)
def test_what_is_no_scene_is_named(given: bytes, said: str) -> None:
    refuses("input-format", lambda: load(given), said)


@pytest.mark.parametrize("name", ["ply", "spz v3", "spz v4", "splat", "sog"])
def test_a_packed_scene_is_unpacked(name: str, tmp_path: Path) -> None:
    data = EXAMPLES[name]
    ending = name.split()[0]
    added = {"readme.txt": b"hello", "__MACOSX/._scene.ply": b"macOS adds such files"}
    for file, packed in (("scene.zip", zipped({f"export/scene.{ending}": data} | added)), ("gz", gzip.compress(data))):
        path = tmp_path / (file if file != "gz" else f"scene.{ending}.gz")
        path.write_bytes(packed)
        np.testing.assert_array_equal(read_scene(path).positions, read_scene(data, format=ending).positions)


@pytest.mark.parametrize("name", ["ply", "spz v3"])
def test_members_of_gzip_files_are_read_one_after_the_other(name: str) -> None:
    """As `bgzip` and appending writers make them; what follows the last is no member."""
    data = EXAMPLES[name] if name == "ply" else gzip.decompress(EXAMPLES[name])
    packed = b"".join(gzip.compress(data[at : at + 13]) for at in range(0, len(data), 13))
    for tail in (b"", bytes(40), b"tail"):
        np.testing.assert_array_equal(read_scene(packed + tail).sh, read_scene(EXAMPLES[name]).sh)
    refuses("input-corrupt", lambda: load(packed[:-30], format="spz" if name != "ply" else None))


def test_files_that_a_scene_in_an_archive_names_are_read_from_it() -> None:
    document, data = gltf_document()
    document["buffers"][0]["uri"] = "data%20of/scene.bin"
    document["images"] = [{"uri": "textures/a.png"}]
    files = {"scene.gltf": json.dumps(document).encode(), "data of/scene.bin": data, "textures/a.png": b"\x89PNG"}
    plain = read_scene(EXAMPLES["gltf glb"])
    for prefix in ("", "export/"):
        np.testing.assert_array_equal(read_scene(zipped(files, prefix=prefix)).sh, plain.sh)
    del files["data of/scene.bin"]
    refuses("input-incomplete", lambda: load(zipped(files)))


def test_an_archive_that_unpacks_to_far_more_than_a_scene_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("scarfmt.formats.packed.FREE_BYTES", 1000)
    refuses("input-limit", lambda: load(gzip.compress(bytes(100_000))))


def test_unknown_format_id_is_refused_with_the_list_of_formats() -> None:
    refuses("input-format", lambda: load(b"", format="dar"), r"dar.*compressed-ply.*spz")


@pytest.mark.parametrize("address", ["https://example.org/a.ply", "ftp://example.org/a.spz"])
def test_an_address_is_no_file(address: str) -> None:
    with pytest.raises(InvalidInput, match="download it") as caught:
        load(address)
    assert address in caught.value.message


@pytest.mark.parametrize(
    ("data", "known"),
    [
        (inria_ply().replace(b"made for a test", b"packed_position was here"), "ply"),
        (inria_ply().replace(b"made for a test", b"long " * 4000), "ply"),
        (compressed_ply().replace(b"element", b"comment " + b"long " * 4000 + b"\nelement", 1), "compressed-ply"),
    ],
)
def test_comments_do_not_decide_between_formats(data: bytes, known: str) -> None:
    assert detect(Source(data)).id == known
    assert len(read_scene(data)) > 0


def test_a_folder_says_which_scene_in_it_to_give(tmp_path: Path) -> None:
    (tmp_path / "splat.ply").write_bytes(inria_ply())
    refuses("input-folder", lambda: load(tmp_path), r"such as splat\.ply")


def test_missing_file_is_an_input_error(tmp_path: Path) -> None:
    refuses("input-unreadable", lambda: load(tmp_path / "absent.ply"))


@pytest.mark.scene
@pytest.mark.parametrize(
    ("name", "count", "degree"),
    [
        ("flowers.ply", 542104, 2),
        ("plush-on-bed.ply", 249960, 3),
        ("plush-dog.ply", 15105, 3),
        ("fruit-drops.ply", 4721, 3),
        ("flower-tile.ply", 14051, 3),
        ("biker.spz", 152746, 0),
        ("biker.compressed.ply", 152746, 0),
        ("plant.splat", 113648, 0),
        ("angel.sog", 71359, 0),
        ("massa.sog", 58649, 0),
    ],
)
def test_real_scenes_have_their_published_counts(shared_data: Path, name: str, count: int, degree: int) -> None:
    scene = read_scene(shared_data / "splats" / name)
    assert (len(scene), scene.sh_degree) == (count, degree)
    assert not scene.invalid_rows().any()
