"""Archives of equal files are equal bytes, in whatever order they come, and what differs is named."""

from __future__ import annotations

import os
import tarfile
from pathlib import Path

from scarfmt_conformance.archive import write_zip

from release.archives import contents, settle_tar
from release.compare import differences

EPOCH = 1_700_000_000
FILES = {"a/one.txt": b"one" * 100, "b.bin": bytes(range(256)), "run.sh": b"#!/bin/sh\n"}


def _packed(folder: Path, names: list[str], when: int, mode: int) -> Path:
    """A `.tar.gz` as tools write it: in some order, of some time and owner."""
    target = folder / "packed.tar.gz"
    with tarfile.open(target, "w:gz") as archive:
        for name in names:
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(FILES[name])
            path.chmod(mode | (0o100 if name.endswith(".sh") else 0))
            os.utime(path, (when, when))
            entry = archive.gettarinfo(path, name)
            entry.uid, entry.uname = when % 1000, f"user{when}"
            with path.open("rb") as file:
                archive.addfile(entry, file)
    return target


def test_a_settled_archive_depends_on_names_and_contents_alone(tmp_path: Path) -> None:
    first = _packed(tmp_path, list(FILES), 1_600_000_000, 0o600)
    settle_tar(first, EPOCH)
    one = first.read_bytes()
    second = _packed(tmp_path, list(reversed(FILES)), 1_650_000_000, 0o664)
    settle_tar(second, EPOCH)
    assert second.read_bytes() == one
    assert contents(second) == FILES
    with tarfile.open(second) as archive:
        assert {member.name: (member.mode, member.mtime, member.uid) for member in archive} == {
            "a/one.txt": (0o644, EPOCH, 0), "b.bin": (0o644, EPOCH, 0), "run.sh": (0o755, EPOCH, 0),
        }  # fmt: skip


def test_a_difference_is_named_down_to_the_member(tmp_path: Path) -> None:
    for name, text in (("one", b"here"), ("other", b"there")):
        (tmp_path / name).mkdir()
        write_zip(tmp_path / name / "same.zip", dict(reversed(FILES.items())) if name == "one" else FILES, True)
        write_zip(tmp_path / name / "changed.zip", FILES | {"b.bin": text})
    (tmp_path / "one" / "alone").touch()
    assert differences(tmp_path / "one", tmp_path / "other") == ["alone is only in one of them", "changed.zip: b.bin"]
    write_zip(tmp_path / "other" / "same.zip", FILES)
    assert "same.zip: equal members, in another order or with other times or modes" in differences(
        tmp_path / "one", tmp_path / "other"
    )
