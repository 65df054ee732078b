"""PlayCanvas streamed SOG, version 1: `lod-meta.json` beside SOG files, bundled or in folders; also all in a ZIP.

A tree of boxes covers the scene. Its leaves name, for each level of detail, runs of Gaussians in the files. Level 0 is
the scene; coarser levels are copies of it with fewer Gaussians and are not read. The `environment`, such as a sky,
belongs to the scene and comes last. Files from before there was a version lack that field.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any

import numpy as np

from scarfmt.arrays import I64
from scarfmt.errors import LimitExceeded, Unsupported
from scarfmt.formats import sog
from scarfmt.formats.source import MAX_GAUSSIANS, Source, is_zip, member_names, open_folder
from scarfmt.scene.description import Description
from scarfmt.scene.gaussians import GaussianScene, concatenate

INDEX = "lod-meta.json"
_FINEST = "0"


def sniff(source: Source) -> bool:
    """Whether the content is an index of levels of detail, or a ZIP archive with one."""
    if is_zip(source):
        return any(PurePosixPath(name).name == INDEX for name in member_names(source))
    return source.document is not None and {"lodLevels", "tree"} <= source.document.keys()


def load(source: Source) -> GaussianScene:
    """Read level 0, the finest, and the environment.

    Raises:
        InvalidInput: damaged, a file is missing, or the index is read from memory.
        Unsupported: a newer version.
        LimitExceeded: a larger index, or more Gaussians than any scene has.
    """
    parts = []
    with open_folder(source, INDEX) as (folder, index):
        for part in finest(index):
            file = folder.source(part.name)
            scene = sog.load(file) if is_zip(file) else sog.read(folder.below(part.name.parent), file)
            parts.append(part.of(index, scene))
            if sum(map(len, parts)) > MAX_GAUSSIANS:
                raise LimitExceeded("input-limit", f"{source.name}: more than {MAX_GAUSSIANS} Gaussians")
    return concatenate(parts)


def describe(source: Source) -> Description:
    """What `model` of the index, or of the first file if that is here, says: how the scene was trained."""
    if source.path is None and not is_zip(source):
        return Description(sog.model_of(source))
    with open_folder(source, INDEX) as (folder, index):
        if (index.document or {}).get("model") is not None:
            return Description(sog.model_of(index))
        file = folder.source(finest(index)[0].name)
        return sog.describe(file) if is_zip(file) else Description(sog.model_of(file))


@dataclass(frozen=True)
class Part:
    """A file of the finest level.

    Attributes:
        name: path of its `meta.json` or bundle, below the directory of the index.
        runs: first Gaussian and number of those that belong to the level, ascending; None for all.
    """

    name: PurePosixPath
    runs: tuple[tuple[int, int], ...] | None

    def rows(self, source: Source, count: int) -> I64:
        """(n,) which of the `count` Gaussians of the file belong to the level, ascending.

        Raises:
            InvalidInput: ``input-corrupt``: the file has fewer than the index says.
        """
        if self.runs is None:
            return np.arange(count)
        total = sum(length for _, length in self.runs)
        if total > count or any(first + length > count for first, length in self.runs):
            raise source.corrupt(f"asks for {total} of the {count} Gaussians of {self.name}", field="tree.lods")
        return np.concatenate([np.arange(first, first + length) for first, length in self.runs])

    def of(self, source: Source, chunk: GaussianScene) -> GaussianScene:
        """The Gaussians of the file that belong to the level; most often that is all of them, in order."""
        rows = self.rows(source, len(chunk))
        return chunk if np.array_equal(rows, np.arange(len(chunk))) else chunk.take(rows)


def finest(source: Source) -> list[Part]:
    """The files that hold level 0, by name, and last that of the environment.

    Raises:
        InvalidInput: the index is damaged, or has none.
        Unsupported: a newer version.
        LimitExceeded: a larger index.
    """
    index = _index(source)
    names = _names(source, index)
    runs: dict[PurePosixPath, list[tuple[int, int]]] = {}
    for file, first, count in _finest_runs(source, index.get("tree"), len(names)):
        runs.setdefault(names[file], []).append((first, count))
    parts = [Part(name, tuple(sorted(wanted))) for name, wanted in sorted(runs.items())]
    if index.get("environment") is not None:
        parts.append(Part(_path(source, index["environment"], "environment"), None))
    if not parts:
        raise source.corrupt(f"no leaf of the tree has Gaussians of level {_FINEST}", field="tree")
    return parts


def _index(source: Source) -> dict[str, Any]:
    index = source.document or source.json()
    if index.get("version", 1) != 1:
        message = f"{source.name}: streamed SOG version {index['version']!r}; this importer reads 1"
        raise Unsupported("input-version", message)
    return index


def _names(source: Source, index: dict[str, Any]) -> list[PurePosixPath]:
    names = index.get("filenames")
    if not isinstance(names, list):
        raise source.corrupt("expected a list of file names", field="filenames")
    return [_path(source, name, "filenames") for name in names]


def _path(source: Source, name: object, field: str) -> PurePosixPath:
    """A path below the directory of the index."""
    path = source.beside(name, field)
    if path.name != sog.META and path.suffix.lower() != ".sog":
        raise source.corrupt(f"{str(name)[:80]!r} is no relative path of a meta.json or .sog", field=field)
    return path


def _finest_runs(source: Source, tree: object, files: int) -> Iterator[tuple[int, int, int]]:
    """File, first Gaussian and number of Gaussians of every leaf that has some of level 0."""
    waiting = [tree]
    while waiting:
        match waiting.pop():
            case {"children": list(children)}:
                waiting.extend(reversed(children))
            case {"lods": {"0": {"file": int(file), "offset": int(first), "count": int(count)}}}:
                if not 0 <= file < files or first < 0 or count < 0:
                    raise source.corrupt(f"Gaussians {first} to {first + count} of file {file}", field="tree.lods")
                yield file, first, count
            case {"lods": dict(levels)} if _FINEST not in levels:
                pass
            case _:
                raise source.corrupt("a node has neither children nor levels of detail that can be read", field="tree")
