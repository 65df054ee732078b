"""A file appears whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from scarfmt.atomic import atomic_write
from scarfmt.errors import InvalidInput


def test_file_appears_only_at_the_end(tmp_path: Path) -> None:
    path = tmp_path / "out"
    with atomic_write(path) as stream:
        stream.write(b"whole")
        assert not path.exists()
    assert path.read_bytes() == b"whole"
    assert os.listdir(tmp_path) == ["out"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_failure_leaves_the_old_file_and_nothing_else(tmp_path: Path, error: type[BaseException]) -> None:
    path = tmp_path / "out"
    path.write_bytes(b"old")

    def fail() -> None:
        with atomic_write(path, force=True) as stream:
            stream.write(b"new")
            raise error

    with pytest.raises(error):
        fail()
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["out"]


def test_existing_file_is_refused_before_any_work(tmp_path: Path) -> None:
    path = tmp_path / "out"
    path.write_bytes(b"old")
    with pytest.raises(InvalidInput) as caught, atomic_write(path):
        pytest.fail("the block was entered")
    assert caught.value.refusal == "output-exists"


def test_file_that_appeared_meanwhile_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "out"

    def write_late() -> None:
        with atomic_write(path) as stream:
            stream.write(b"mine")
            path.write_bytes(b"theirs")

    with pytest.raises(InvalidInput):
        write_late()
    assert path.read_bytes() == b"theirs"
    assert os.listdir(tmp_path) == ["out"]


@pytest.mark.parametrize("name", ["", "absent/out", "file/out", 300 * "n"])
def test_what_is_no_place_for_a_file_is_refused(tmp_path: Path, name: str) -> None:
    """The temporary file that could not be made hides the reason as little as that it cannot be removed."""
    (tmp_path / "file").touch()
    with pytest.raises(InvalidInput) as caught, atomic_write(tmp_path / name, force=True):
        pytest.fail("the block was entered")
    assert caught.value.refusal == "output-path"


def test_new_file_has_ordinary_permissions(tmp_path: Path) -> None:
    """The mode is not the private one that temporary file helpers give."""
    with atomic_write(tmp_path / "out"):
        pass
    (tmp_path / "plain").touch()
    assert (tmp_path / "out").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_symbolic_link_is_followed(tmp_path: Path) -> None:
    (tmp_path / "target").write_bytes(b"old")
    (tmp_path / "link").symlink_to(tmp_path / "target")
    with atomic_write(tmp_path / "link", force=True) as stream:
        stream.write(b"new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "target").read_bytes() == b"new"


def test_device_is_written_directly() -> None:
    with atomic_write(os.devnull) as stream:
        stream.write(b"gone")
    assert not Path(os.devnull).is_file()


@pytest.mark.skipif(os.name != "posix", reason="POSIX permissions")
@pytest.mark.parametrize("mode", [0o600, 0o640, 0o755])
def test_a_replaced_file_keeps_its_permissions(tmp_path: Path, mode: int) -> None:
    """The permissions hold while it is written, too: what was private is never readable."""
    path = tmp_path / "out"
    path.write_bytes(b"old")
    path.chmod(mode)
    with atomic_write(path, force=True):
        (temporary,) = tmp_path.glob(".out.*.part")
        assert temporary.stat().st_mode & 0o777 == mode
    assert path.stat().st_mode & 0o777 == mode


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root may give files away")
def test_a_replaced_file_keeps_its_owner(tmp_path: Path) -> None:
    path = tmp_path / "out"
    path.write_bytes(b"old")
    os.chown(path, 1234, 2345)
    with atomic_write(path, force=True):
        pass
    assert (path.stat().st_uid, path.stat().st_gid) == (1234, 2345)


@pytest.mark.parametrize("name", ["a" * 255, "木" * 80, "é" * 127, "x" + "木" * 84])
def test_names_as_long_as_the_system_allows_are_written(tmp_path: Path, name: str) -> None:
    """The limit counts bytes, and the temporary name is longer than the name."""
    with atomic_write(tmp_path / name) as stream:
        stream.write(b"whole")
    assert (tmp_path / name).read_bytes() == b"whole"
