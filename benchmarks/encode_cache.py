"""A cache of encoded files and of what was measured on them; a stale entry is never used.

The name of a file says what it was made from: scene, options, and a hash of the encoder's source, of the packages it
computes with and of the scene's own bytes. FILE.json beside it holds what making it took.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from benchmarks import child
from benchmarks.child import note_path
from benchmarks.report import SCRATCH
from benchmarks.scenes import REPOSITORY, Scene

DRAWING = (
    "scarfmt/formats",
    *(f"scarfmt/render/{name}.py" for name in ("projection", "rasterise", "compare", "metrics")),
)
"""Source files that decide how far a picture of a scene file is from another."""
ENCODER = ("reference_encoder", "scarfmt")
"""Packages whose source decides what a file holds."""
_NOT_ENCODER = "scarfmt/cli"
_SOURCE = {".py", ".c", ".h"}
_COMPUTES = ("numpy",)
_DIGITS = 12


@lru_cache
def source_key(packages: tuple[str, ...] = ENCODER) -> str:
    """Hex digits that change with any source file of `packages`; the command line does not count.

    Args:
        packages: folders, or single files, in the repository.
    """
    roots = [REPOSITORY / package for package in packages]
    paths = (path for root in roots for path in ([root] if root.is_file() else root.rglob("*")))
    names = {path.relative_to(REPOSITORY).as_posix(): path for path in paths if path.suffix in _SOURCE}
    digest = hashlib.sha256()
    for name in sorted(names):
        if not name.startswith(_NOT_ENCODER):
            digest.update(f"{name}\0{file_key(names[name])}\0".encode())
    return digest.hexdigest()


@lru_cache
def file_key(path: Path) -> str:
    """Hex digits of a hash of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def key_of(parts: Iterable[object]) -> str:
    """Some hex digits of a hash of `parts`, with the encoder's source and packages."""
    packages = [f"{name} {version(name)}" for name in _COMPUTES]
    text = "\0".join(map(str, [source_key(), *packages, *parts]))
    return hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]


def judging_key(scene: Scene) -> str:
    """Changes with the views a scene is judged from, and with what is made of their pictures."""
    how = (file_key(REPOSITORY / "benchmarks" / name) for name in ("views.py", "judge.py"))
    captured = "" if scene.captured is None else file_key(scene.captured)
    return "\0".join([*how, scene.up, captured])


def cache_path(scene: Scene, what: str, suffix: str = ".scar") -> Path:
    """The path of a file made of `scene`; `what` names it and everything it depends on but scene and source."""
    files = [file_key(path) for path in (scene.path, scene.known) if path is not None]
    SCRATCH.mkdir(parents=True, exist_ok=True)
    stem = "".join(c if c.isalnum() or c == "-" else "_" for c in scene.name)
    short = "".join(c if c.isalnum() or c in "-." else "_" for c in what)
    return SCRATCH / f"{stem}-{short}-{key_of([*files, what])}{suffix}"


def encode_scene(scene: Scene, quality: float, effort: int) -> dict[str, Any]:
    """The file of a scene, encoded in a process of its own unless it is there.

    Returns:
        ``path``, ``bytes``, ``seconds`` and ``peak_bytes`` of making it.
    """
    path = cache_path(scene, f"q{quality:g}-e{effort}")
    note = note_path(path)
    if not (path.exists() and note.exists()):
        options = {"quality": quality, "effort": effort}
        child.run(job="encode", scene=scene.name, options=options, out=str(path))
    return {"path": str(path), **json.loads(note.read_text(encoding="utf-8"))}
