"""Archives whose bytes depend on names and contents alone: sorted, of one time, owned by nobody."""

from __future__ import annotations

import gzip
import io
import tarfile
import zipfile
from pathlib import Path

_PLAIN, _PROGRAM = 0o644, 0o755


def settle_tar(path: Path, epoch: int) -> None:
    """Write a `.tar.gz` anew: members sorted, of one time and owner, without folders, which unpacking makes itself.

    Raises:
        ValueError: it holds something that is neither file nor folder.
    """
    with tarfile.open(path, "r:gz") as old:
        found = {member.name: member for member in old if not member.isdir()}
        if strange := [name for name, member in found.items() if not member.isfile()]:
            raise ValueError(f"{path.name} holds more than files: {strange}")
        contents = {name: _read(old, found[name]) for name in sorted(found)}
    plain = io.BytesIO()
    with tarfile.open(fileobj=plain, mode="w", format=tarfile.PAX_FORMAT) as new:
        for name, data in contents.items():
            entry = tarfile.TarInfo(name)
            entry.size, entry.mtime = len(data), epoch
            entry.mode = _PROGRAM if found[name].mode & 0o100 else _PLAIN
            new.addfile(entry, io.BytesIO(data))
    with path.open("wb") as file, gzip.GzipFile("", "wb", 9, file, mtime=epoch) as target:
        target.write(plain.getvalue())


def contents(path: Path) -> dict[str, bytes]:
    """Files of a ZIP or `.tar.gz` by name; those of any other file, itself alone."""
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            return {name: archive.read(name) for name in archive.namelist()}
    if path.name.endswith((".tgz", ".tar.gz")):
        with tarfile.open(path, "r:gz") as tar:
            return {member.name: _read(tar, member) for member in tar if member.isfile()}
    return {path.name: path.read_bytes()}


def _read(archive: tarfile.TarFile, member: tarfile.TarInfo) -> bytes:
    file = archive.extractfile(member)
    assert file is not None  # of a regular file there always is one
    return file.read()
