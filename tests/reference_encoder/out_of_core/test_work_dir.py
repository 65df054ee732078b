"""A work directory holds whole files of one plan for one encoding at a time, on a disk and at a URL."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import pickle
import subprocess
import sys
from pathlib import Path

import fsspec
import numpy as np
import pytest

from reference_encoder.importance.view_sampling import ViewSet
from reference_encoder.options import EncodeOptions
from reference_encoder.out_of_core.work_dir import (
    LOCK,
    PLAN,
    WorkDir,
    describe,
    exists,
    file_version,
    is_folder,
    list_folder,
    local_path,
    resolve_beside,
)
from scarfmt.errors import InvalidInput
from scarfmt.render.camera import look_at
from tests.samples.codec_samples import refuses

PLACES = ["{}/work", "file://{}/work", "memory://{}/work"]


def fail_half_way(work: WorkDir, name: str, error: Exception) -> None:
    with work.write(name) as stream:
        stream.write(b"half")
        raise error


@pytest.mark.parametrize("place", PLACES)
def test_what_is_written_is_read(tmp_path: Path, place: str) -> None:
    work = WorkDir(place.format(tmp_path))
    assert work.names("a") == set()
    with work.write("a/one") as stream:
        stream.write(b"0123456789")
    work.put("a/two", {"x": (1, 2)})
    assert work.names("a") == {"one", "two"}
    assert work.read_ranges("a/one", [(2, 3), (9, 1)]) == [b"234", b"9"]
    assert work.get("a/two") == {"x": (1, 2)}
    work.put("a/two", 5)
    assert work.get("a/two") == 5


@pytest.mark.parametrize("place", PLACES)
def test_a_file_that_is_not_finished_is_not_there(tmp_path: Path, place: str) -> None:
    """Nor does it take the place of one that was."""
    work = WorkDir(place.format(tmp_path))
    work.put("a/kept", 1)
    for name in ("a/kept", "a/new"):
        with pytest.raises(RuntimeError):
            fail_half_way(work, name, RuntimeError())
    assert work.names("a") == {"kept"}
    assert work.get("a/kept") == 1
    assert len(fsspec.core.url_to_fs(work.path("a"))[0].ls(work.path("a"))) == 1


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT])
def test_a_full_disk_is_told_and_leaves_nothing_half_written(tmp_path: Path, place: str, code: int) -> None:
    work = WorkDir(place.format(tmp_path))
    refuses("work-full", lambda: fail_half_way(work, "a/one", OSError(code, "fake")), "--resume")
    assert work.names("a") == set()


def test_other_errors_of_the_system_stay_what_they_are(tmp_path: Path) -> None:
    with pytest.raises(PermissionError):
        fail_half_way(WorkDir(str(tmp_path)), "one", PermissionError(errno.EACCES, "fake"))


def test_what_a_killed_process_left_is_not_taken_for_a_file_and_goes(tmp_path: Path) -> None:
    folder = tmp_path / "a"
    folder.mkdir()
    (folder / "one.0123.part").write_bytes(b"half")
    work = WorkDir(str(tmp_path))
    assert work.names("a") == set()
    work.remove_unfinished()
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("place", PLACES)
def test_folders_and_files_are_found(tmp_path: Path, place: str) -> None:
    root = WorkDir(place.format(tmp_path))
    for name in ("b", "a"):
        root.put(name, 1)
    assert is_folder(root.place)
    assert not is_folder(root.path("a"))
    assert [name.rpartition("/")[2] for name in list_folder(root.place)] == ["a", "b"]
    assert all(exists(name) for name in list_folder(root.place))
    assert int(file_version(root.path("a"))["size"]) > 0
    refuses("input-source", lambda: file_version(root.path("c")))


def test_a_name_in_a_file_lies_beside_that_file() -> None:
    assert resolve_beside("/scenes/lod-meta.json", "0_0/meta.json") == "/scenes/0_0/meta.json"
    assert resolve_beside("s3://bucket/scene/lod-meta.json", "0_0/meta.json") == "s3://bucket/scene/0_0/meta.json"
    assert local_path("file:///scenes/a.ply") == Path("/scenes/a.ply")
    assert local_path("s3://bucket/a.ply") is None
    refuses("input-source", lambda: exists("nonsense://a/b"))


def refuse(work: WorkDir) -> str:
    with pytest.raises(InvalidInput) as caught, work.lock():
        pass
    assert caught.value.refusal == "work-in-use"
    return str(caught.value)


@pytest.mark.parametrize("place", PLACES)
def test_a_directory_in_use_is_refused_and_free_after_an_error(tmp_path: Path, place: str) -> None:
    work = WorkDir(place.format(tmp_path))
    with work.lock():
        assert f"process {os.getpid()} of" in refuse(work)
    with pytest.raises(RuntimeError), work.lock():
        raise RuntimeError
    with work.lock():
        pass


HOLDER = """
import sys, time
from reference_encoder.options import EncodeOptions
from reference_encoder.out_of_core.work_dir import WorkDir
with WorkDir(sys.argv[1]).lock():
    print("held", flush=True)
    time.sleep(600)
"""


@pytest.mark.skipif(os.name != "posix", reason="locks that the system lets go of")
def test_the_lock_of_a_killed_process_is_taken_over(tmp_path: Path) -> None:
    """Its file still names the process."""
    with subprocess.Popen([sys.executable, "-c", HOLDER, str(tmp_path)], stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout.readline() == "held\n"
        assert f"process {holder.pid} of" in refuse(WorkDir(str(tmp_path)))
        holder.kill()
        holder.wait()
    with WorkDir(str(tmp_path)).lock():
        assert json.loads((tmp_path / LOCK).read_text())["process"] == os.getpid()


@pytest.mark.parametrize("owner", [b"", b"{", b"[]", b'{"host": "elsewhere", "process": 1}'])
def test_a_lock_at_a_url_is_left_to_people(tmp_path: Path, owner: bytes) -> None:
    """Nobody knows whether its process ended; its file may be cut short."""
    work = WorkDir(f"memory://{tmp_path}/work")
    with work.write(LOCK) as file:
        file.write(owner)
    assert f"remove {work.path(LOCK)}" in refuse(work)


def test_equal_values_are_described_alike_and_others_are_not() -> None:
    """Cameras hold arrays; metadata come in any order."""

    def options(far: float, metadata: dict[str, int]) -> object:
        camera = look_at(np.array([far, 0.0, 0.0]), np.zeros(3), np.array([0.0, 1.0, 0.0]), 64, 48, 1.0)
        return describe(EncodeOptions(cameras=[camera], metadata=metadata))

    assert options(1, {"a": 1, "b": 2}) == options(1, {"b": 2, "a": 1})
    assert options(1, {}) != options(2, {})
    assert describe(0.1) != describe(np.float32(0.1))


def test_values_come_back_as_they_were_and_can_be_written_to(tmp_path: Path) -> None:
    """Of the kinds that steps hand on: others are refused before anything is written."""
    work = WorkDir(str(tmp_path))
    numbers = np.arange(6, dtype="<u2").reshape(2, 3)
    value = ({"a": [1.5, None, float("inf")], 3: (b"\0x", "\ud800")}, numbers, EncodeOptions(seed=4), ViewSet.TUNING)
    work.put("one", value)
    found = work.get("one")
    assert found[:1] + found[2:] == value[:1] + value[2:]
    assert type(found[3]) is ViewSet
    np.testing.assert_array_equal(found[1], numbers)
    found[1][0] = 7
    for other in (np.array([None]), Path("x"), {1}):
        with pytest.raises(TypeError):
            work.put("two", other)
    assert work.names() == {"one"}


def test_a_damaged_file_is_told_and_nothing_of_it_is_used(tmp_path: Path) -> None:
    """Also one whose digest is right, but that names what no step writes."""
    work = WorkDir(str(tmp_path))
    work.put("one", [1, np.zeros(3)])
    data = (tmp_path / "one").read_bytes()
    for changed in (b"", data[:20], data[:-1], data[:60] + b"?" + data[61:], pickle.dumps([1])):
        (tmp_path / "one").write_bytes(changed)
        refuses("work-damaged", lambda: work.get("one"))
    for name in ("system", "Popen", "Camera"):
        text = json.dumps({name: [1]}).encode()
        content = len(text).to_bytes(8, "little") + text
        (tmp_path / "one").write_bytes(b"scarwrk1" + hashlib.sha256(content).digest() + content)
        refuses("work-damaged", lambda: work.get("one"))
    (tmp_path / PLAN).write_bytes(b"{")
    refuses("work-damaged", lambda: work.begin({}, resume=True))


def test_finished_work_without_a_plan_is_not_believed(tmp_path: Path) -> None:
    """It may be of another scene."""
    WorkDir(str(tmp_path)).put("done/scan/000000", 1)
    refuses("work-plan", lambda: WorkDir(str(tmp_path)).begin({}, resume=True))
