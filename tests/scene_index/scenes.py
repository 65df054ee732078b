"""Small scenes of two files, on disk and in memory."""

from __future__ import annotations

import math
from pathlib import Path

from fuzz.testing.scenes import random_scene
from reference_decoder.scenes.making import Rows, listed_file, make_index
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.writer import write_scene
from scarfmt.container.schema import Profile
from scarfmt.container.source import BytesSource
from scarfmt.scene_index.document import Index

DATA = tuple(write_scene(random_scene(seed, anchors=300, tiles=5, layers=2 + seed, sh_degree=seed)) for seed in (1, 2))
"""Two files of 3 and 4 layers, with harmonics of degree 1 and 2."""
ANCHORS = write_scene(random_scene(3, Profile.ANCHOR, anchors=60))
NAMES = ("a.scar", "deep/b.scar")
_C, _S = math.cos(0.7), math.sin(0.7)
PLACED: Rows = [[3 * _C, -3 * _S, 0, 10], [3 * _S, 3 * _C, 0, -2], [0, 0, 3, 1], [0, 0, 0, 1]]
"""Turned about z, three times as large, and moved."""


def made(transform: Rows | None = None) -> Index:
    """An index of both; the second is placed."""
    files = []
    for name, data, rows in zip(NAMES, DATA, (None, transform), strict=True):
        source = BytesSource(data)
        files.append(listed_file(SceneReader(source), source, name, rows))
    return Index(tuple(files))


def scene_folder(folder: Path, transform: Rows | None = None) -> Path:
    """Writes both files and their index, whose path is given back."""
    paths = [folder / name for name in NAMES]
    for path, data in zip(paths, DATA, strict=True):
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(data)
    index = make_index(paths, folder, {} if transform is None else {NAMES[1]: transform})
    (folder / "scene.scar.json").write_bytes(index.text())
    return folder / "scene.scar.json"
