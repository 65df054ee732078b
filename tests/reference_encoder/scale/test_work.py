"""Files of a work directory are whole or not there, on a disk and at a URL."""

from __future__ import annotations

import errno
from pathlib import Path

import fsspec
import pytest

from reference_encoder.scale import work as module
from reference_encoder.scale.work import Work
from scarfmt.errors import InvalidInput

PLACES = ["{}/work", "file://{}/work", "memory://{}/work"]


def fail_half_way(work: Work, name: str, error: Exception) -> None:
    with work.write(name) as stream:
        stream.write(b"half")
        raise error


@pytest.mark.parametrize("place", PLACES)
def test_what_is_written_is_read(tmp_path: Path, place: str) -> None:
    work = Work(place.format(tmp_path))
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
    work = Work(place.format(tmp_path))
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
    work = Work(place.format(tmp_path))
    with pytest.raises(InvalidInput, match="--resume") as caught:
        fail_half_way(work, "a/one", OSError(code, "fake"))
    assert caught.value.refusal == "work-full"
    assert work.names("a") == set()


def test_other_errors_of_the_system_stay_what_they_are(tmp_path: Path) -> None:
    with pytest.raises(PermissionError):
        fail_half_way(Work(str(tmp_path)), "one", PermissionError(errno.EACCES, "fake"))


def test_what_a_killed_process_left_is_not_taken_for_a_file_and_goes(tmp_path: Path) -> None:
    folder = tmp_path / "a"
    folder.mkdir()
    (folder / f".one.0123{module._UNFINISHED}").write_bytes(b"half")
    work = Work(str(tmp_path))
    assert work.names("a") == set()
    work.tidy("a")
    assert list(folder.iterdir()) == []
