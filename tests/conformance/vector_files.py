"""The vectors on disk, for the tests."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from conformance.generate import ROOT, VECTORS

FOLDERS = sorted(path.parent for path in VECTORS.glob("**/expect.json"))


def name_of(folder: Path) -> str:
    """The id of a vector."""
    return folder.relative_to(VECTORS).as_posix()


def expectation_of(folder: Path) -> dict[str, Any]:
    """The ``expect.json`` of a vector."""
    found: dict[str, Any] = json.loads((folder / "expect.json").read_text())
    return found


def manifest() -> dict[str, Any]:
    """``manifest.json``."""
    found: dict[str, Any] = json.loads((ROOT / "manifest.json").read_text())
    return found
