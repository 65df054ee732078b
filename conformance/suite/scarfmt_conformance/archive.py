"""A suite in one file: a zip of the folder with the manifest, as it travels in the wheel.

Nothing here imports scarfmt: the wheel is built without it.
"""

from __future__ import annotations

import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

OWN = Path(__file__).resolve().parent / "vectors.zip"
"""The suite of an installed wheel; absent in a checkout, which has the folder."""

_FILES = ("manifest.json", "manifest.schema.json", "expect.schema.json", "PROTOCOL.md")
_VECTORS = "vectors"
# The same vectors make the same archive.
_DATE = (1980, 1, 1, 0, 0, 0)


def suite_files(folder: Path) -> list[Path]:
    """Manifest, schemas, protocol and vectors of a folder: what the runner needs, always in one order."""
    vectors = sorted(path for path in (folder / _VECTORS).rglob("*") if path.is_file())
    return [*(folder / name for name in _FILES), *vectors]


def pack(folder: Path, target: Path) -> None:
    """Write the manifest, its schemas, the protocol and the vectors of a folder to a zip.

    Nothing in it is compressed: the wheel is, and does better across files that are alike.

    Raises:
        FileNotFoundError: the folder lacks one of them.
    """
    with zipfile.ZipFile(target, "w") as archive:
        for path in suite_files(folder):
            entry = zipfile.ZipInfo(path.relative_to(folder).as_posix(), _DATE)
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, path.read_bytes())


def unpack(archive: Path, folder: Path) -> None:
    """Write the files of a suite's zip below a folder.

    Raises:
        zipfile.BadZipFile: it is not a zip, or damaged.
        OSError: it cannot be read, or the files not be written.
    """
    with zipfile.ZipFile(archive) as opened:
        opened.extractall(folder)


@contextmanager
def unpacked(place: Path) -> Iterator[Path]:
    """The folder of a suite: `place` itself, or, of a zip, one that is removed afterwards.

    Raises:
        zipfile.BadZipFile, OSError: as :func:`unpack`.
    """
    if place.is_dir():
        yield place
        return
    with tempfile.TemporaryDirectory(prefix="scar-vectors-") as folder:
        unpack(place, Path(folder))
        yield Path(folder)
