"""Vectors as files and as a suite, for the tests."""

from __future__ import annotations

import atexit
import shutil
import tempfile
from functools import cache
from pathlib import Path

from scarfmt_conformance.archive import expectation, read


@cache
def _folder() -> Path:
    folder = Path(tempfile.mkdtemp(prefix="scar-vectors-"))
    atexit.register(shutil.rmtree, folder)
    return folder


@cache
def vector_file(id_: str) -> Path:
    """The scene of a vector as a file, with the zeros that `extend_to` of its expectation says (sparse)."""
    path = _folder() / f"{id_.replace('/', '-')}.scar"
    path.write_bytes(read(id_))
    length = expectation(id_).get("extend_to", 0)
    if length:
        with path.open("r+b") as file:
            file.truncate(length)
    return path
