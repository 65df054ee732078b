"""The vectors: one zip a class beside the manifest, or the whole suite in one zip, as it travels in the wheel.

``vectors/CLASS.zip`` of a checkout holds ``vectors/CLASS/NAME/input.scar``, ``expect.json`` and references of activated
values, stored, so that equal vectors make equal bytes everywhere. Nothing here imports scarfmt: the wheel is built
without it.
"""

from __future__ import annotations

import fnmatch
import json
import shutil
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

OWN = Path(__file__).resolve().parent / "vectors.zip"
"""The suite of an installed wheel; absent in a checkout, which has the folder."""

CHECKOUT = Path(__file__).resolve().parents[2]
"""The folder of the suite in a checkout."""

VECTORS = "vectors"
_INPUT, _EXPECT = "input.scar", "expect.json"
_FILES = ("manifest.json", "manifest.schema.json", "expect.schema.json", "PROTOCOL.md")
_DATE = (1980, 1, 1, 0, 0, 0)


def names(*patterns: str) -> list[str]:
    """Ids of the checkout's vectors, sorted: all, or those that match one of some shell patterns."""
    past = -len(f"/{_INPUT}")
    ids = (path[len(VECTORS) + 1 : past] for path in members(CHECKOUT) if path.endswith(f"/{_INPUT}"))
    return sorted(id_ for id_ in ids if any(fnmatch.fnmatchcase(id_, pattern) for pattern in patterns or "*"))


def read(id_: str, name: str = _INPUT) -> bytes:
    """A file of a vector of the checkout: the scene, or another by its path in the vector's folder.

    Raises:
        KeyError: there is none.
    """
    return members(CHECKOUT)[f"{VECTORS}/{id_}/{name}"]


def expectation(id_: str) -> dict[str, Any]:
    """The ``expect.json`` of a vector of the checkout.

    Raises:
        KeyError: there is none.
    """
    found: dict[str, Any] = json.loads(read(id_, _EXPECT))
    return found


def archives(folder: Path) -> list[Path]:
    """The zips of a suite's vectors, one a class; none where the vectors are files."""
    return sorted((folder / VECTORS).glob("*.zip"))


@cache
def members(folder: Path) -> dict[str, bytes]:
    """Every file in the archives of a folder, by its path below the folder."""
    found: dict[str, bytes] = {}
    for path in archives(folder):
        with zipfile.ZipFile(path) as archive:
            found |= {name: archive.read(name) for name in archive.namelist()}
    return found


def write_zip(target: Path, files: Mapping[str, bytes], compressed: bool = False) -> None:
    """Write a zip of members sorted by name, of one time and owner: equal members make equal bytes."""
    with zipfile.ZipFile(target, "w") as archive:
        for name in sorted(files):
            entry = zipfile.ZipInfo(name, _DATE)
            entry.external_attr = 0o644 << 16
            method = zipfile.ZIP_DEFLATED if compressed else zipfile.ZIP_STORED
            archive.writestr(entry, files[name], method, compresslevel=9)


def suite_files(folder: Path) -> dict[str, bytes]:
    """Manifest, schemas, protocol and vectors of a checkout's folder, by path: what the runner needs.

    Raises:
        FileNotFoundError: the folder lacks one of them.
    """
    return {**{name: (folder / name).read_bytes() for name in _FILES}, **members(folder)}


def pack(folder: Path, target: Path) -> None:
    """Write the suite of a checkout's folder to one zip, uncompressed: the wheel around it is compressed.

    Raises:
        FileNotFoundError: as :func:`suite_files`.
    """
    write_zip(target, suite_files(folder))


@contextmanager
def unpack(place: Path) -> Iterator[Path]:
    """The folder of a suite: `place` itself, or, of a zip or of class archives, one that is removed afterwards.

    Raises:
        zipfile.BadZipFile: it is neither a folder nor a zip, or damaged.
        OSError: it cannot be read, or the files not be written.
    """
    packed = archives(place) if place.is_dir() else [place]
    if not packed:
        yield place
        return
    with tempfile.TemporaryDirectory(prefix="scar-vectors-") as folder:
        for path in packed:
            with zipfile.ZipFile(path) as opened:
                opened.extractall(folder)
        if place.is_dir():
            for name in _FILES:
                if (place / name).exists():
                    shutil.copyfile(place / name, Path(folder) / name)
        yield Path(folder)
