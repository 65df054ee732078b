"""Sources of a scene larger than memory, in chunks: descriptors that can be pickled, and how one is read.

Read are a PLY of INRIA's columns, which is read row by row wherever it is; a streamed SOG (its `lod-meta.json`), of
which every file is read whole; a folder of scenes in any format of :mod:`scarfmt.formats`, one after the other by name;
and a single file of such a format, whole. All may be on this machine or at a URL. The order of Gaussians is always that
in which a reader of everything would have them.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePosixPath

import numpy as np

from reference_encoder.out_of_core.work_dir import (
    content_version,
    exists,
    is_folder,
    list_folder,
    local_path,
    resolve_beside,
)
from scarfmt.arrays import F64, I64
from scarfmt.coding.reader import batches
from scarfmt.container.source import ByteSource, open_source
from scarfmt.errors import InvalidInput, Truncated
from scarfmt.formats import FORMATS, Format, detect, inria_ply, ply, scaffold, sog, streamed_sog
from scarfmt.formats.source import Source
from scarfmt.limits import MAX_ANCHORS
from scarfmt.scene.description import NOTHING_SAID, Description
from scarfmt.scene.gaussians import GaussianScene

CHUNK_ROWS = 1 << 19
"""Gaussians of a chunk, if they can be read by themselves: 130 MB of a PLY of degree 3."""

_PLY, _SOG, _STREAMED = "ply", "sog", "streamed-sog"
_MEMBERS = tuple(ending for known in FORMATS for ending in known.extensions if not ending.endswith(".json"))
"""Endings of files that a folder is read for."""


@dataclass(frozen=True)
class Part:
    """Some Gaussians of one file.

    Attributes:
        name: path or URL.
        format: id of its format.
        runs: first Gaussian and number of those that are meant, ascending; None for all.
    """

    name: str
    format: str
    runs: tuple[tuple[int, int], ...] | None = None


@dataclass(frozen=True)
class Chunk:
    """The part of a source that one task reads.

    Attributes:
        number: 0.. in the order of the scene.
        parts: one after the other.
    """

    number: int
    parts: tuple[Part, ...]


@dataclass(frozen=True)
class Inputs:
    """A scene in chunks.

    Attributes:
        chunks: in order.
        versions: of each file, its :func:`reference_encoder.out_of_core.work_dir.content_version`.
        description: what the first file says about the scene.
    """

    chunks: tuple[Chunk, ...]
    versions: dict[str, dict[str, str]]
    description: Description = NOTHING_SAID


class UrlInput(Source):
    """The bytes at a URL; a PLY of any size is read by ranges."""

    def __init__(self, url: str) -> None:
        super().__init__(b"")
        self._url = url
        self._data = None

    @cached_property
    def ranges(self) -> ByteSource:
        """The connection, opened when it is first used."""
        return open_source(self._url)

    @property
    def name(self) -> str:
        return self._url

    @property
    def file_name(self) -> str:
        return self._url.rpartition("/")[2]

    @property
    def size(self) -> int:
        return self.ranges.size

    def head(self, length: int) -> bytes:
        return self.ranges.read(0, min(length, self.size))

    def read(self) -> bytes:
        if self._data is None:
            self._data = self.ranges.read(0, self.size)
        return self._data


class FetchedSog(Source):
    """An unbundled SOG at a URL, once its files are on this machine."""

    def __init__(self, url: str, folder: Path) -> None:
        self._url = url
        meta = UrlInput(url)
        super().__init__(folder / "meta.json")
        (folder / "meta.json").write_bytes(meta.read())
        for name in _files_of(meta):
            (folder / name).write_bytes(UrlInput(resolve_beside(url, name)).read())

    @property
    def name(self) -> str:
        return self._url


def _files_of(meta: Source) -> Iterator[str]:
    """Bare names of the images that a `meta.json` names."""
    try:
        entries = json.loads(meta.read())
        named = [entry.get("files", []) for entry in entries.values() if isinstance(entry, dict)]
    except (ValueError, AttributeError, RecursionError) as error:
        raise meta.corrupt("meta.json is no object of images") from error
    for names in named:
        for name in names if isinstance(names, list) else []:
            if not isinstance(name, str) or not name or {"/", "\\", "\0"} & set(name) or name == "..":
                raise meta.corrupt(f"{str(name)[:80]!r} is no name of an image")
            yield name


def find_inputs(origin: str, rows: int = CHUNK_ROWS, format_id: str | None = None) -> Inputs:
    """Find out how to read a scene.

    Args:
        origin: path or URL of a file or folder.
        rows: Gaussians of a chunk, where they can be chosen.
        format_id: of the file, or of all files of a folder; by default the content decides.

    Raises:
        InvalidInput: nothing there that can be read; anchor models (``input-not-gaussians``) among it.
        Unsupported, LimitExceeded: as the reader of the format says.
    """
    files = _files(origin)
    parts = [part for name in files for part in _parts(name, rows, format_id)]
    # Parts of unknown size are chunks by themselves.
    groups = batches(parts, lambda part: rows if part.runs is None else sum(count for _, count in part.runs), rows)
    chunks = tuple(Chunk(number, tuple(group)) for number, group in enumerate(groups))
    source = _source(files[0])
    description = _format(source, format_id).describe(source)
    return Inputs(chunks, {name: content_version(name) for name in _read_files(files, parts)}, description)


def _read_files(files: list[str], parts: list[Part]) -> list[str]:
    """All files that the scene is read from: those named, and the images beside a `meta.json` on this machine."""
    names = {*files, *(part.name for part in parts)}
    folders = {path.parent for name in names if name.endswith(".json") and (path := local_path(name)) is not None}
    return sorted(names | {str(path) for folder in folders for path in folder.iterdir() if path.is_file()})


def _files(origin: str) -> list[str]:
    """The file itself, or the files to read of a folder."""
    if not is_folder(origin):
        return [origin]
    for index in (streamed_sog.INDEX, "meta.json"):
        if exists(f"{origin.rstrip('/')}/{index}"):
            return [f"{origin.rstrip('/')}/{index}"]
    path = local_path(origin)
    if path is not None and scaffold.points_of(path) is not None:
        raise _anchors(origin)
    found = [name for name in list_folder(origin) if name.lower().endswith(_MEMBERS)]
    if not found:
        raise InvalidInput("input-empty", f"{origin}: no scene in this folder; expected {', '.join(_MEMBERS)}")
    return found


def _source(name: str) -> Source:
    path = local_path(name)
    return UrlInput(name) if path is None else Source(path)


def _format(source: Source, format_id: str | None) -> Format:
    if format_id is None:
        return detect(source)
    return next(known for known in FORMATS if known.id == format_id)


def _parts(name: str, rows: int, format_id: str | None) -> Iterator[Part]:
    source = _source(name)
    found = _format(source, format_id)
    if found.id in ("scaffold", "anchor-npz"):
        raise _anchors(name)
    if found.id == _STREAMED and source.document is not None:
        for part in streamed_sog.finest(source):
            yield Part(resolve_beside(name, str(part.name)), _SOG, part.runs)
    elif found.id == _PLY and (table := RowTable.of(source)) is not None:
        for note in table.columns.notes:
            source.warn(note)
        for first in range(0, table.count, rows):
            yield Part(name, _PLY, ((first, min(rows, table.count - first)),))
    else:
        yield Part(name, found.id)


def _anchors(name: str) -> InvalidInput:
    message = f"{name}: an anchor model, which is encoded in memory only; leave out --work"
    return InvalidInput("input-not-gaussians", message)


@dataclass(frozen=True)
class RowTable:
    """The place of the rows of Gaussians in a PLY, all of the same size.

    Attributes:
        columns: where attributes are in a row.
        kind: of a row.
        offset: of the first row in the file.
        count: rows.
    """

    columns: inria_ply.Columns
    kind: np.dtype[np.void]
    offset: int
    count: int

    @classmethod
    def of(cls, source: Source) -> RowTable | None:
        """Find the rows of a PLY; None in text, or with lists before its Gaussians, where rows cannot be counted off.

        Raises:
            InvalidInput: ``input-corrupt``, ``input-not-gaussians``, ``input-sh-degree``.
            LimitExceeded: ``input-limit``.
        """
        header = ply.read_header(source)
        columns = inria_ply.Columns.of(source, header)
        ply.check_sizes(source, header, MAX_ANCHORS)
        offset = header.length
        for element in header.elements.values():
            if not header.byte_order or ply.LIST in element.properties.values():
                return None
            if element.name == "vertex":
                return cls(columns, ply.row_type(element, header.byte_order), offset, element.count)
            offset += element.count * element.row_bytes
        return None

    def read(self, source: Source, first: int, count: int) -> ply.Rows:
        """`count` rows from `first`.

        Raises:
            InvalidInput: ``input-corrupt``: the file has got shorter.
        """
        offset, length = self.offset + first * self.kind.itemsize, count * self.kind.itemsize
        if isinstance(source, UrlInput):
            try:
                return np.frombuffer(source.ranges.read(offset, length), self.kind)
            except Truncated as error:
                raise source.corrupt(f"the file ends before row {first + count}") from error
        with source.open() as stream:
            stream.seek(offset)
            rows = np.fromfile(stream, self.kind, count)
        if len(rows) < count:
            raise source.corrupt(f"the file ends in row {first + len(rows)}")
        return rows


def read(part: Part) -> tuple[GaussianScene, I64]:
    """The Gaussians of a part, as stored, and which rows of its file they are, (N,) int64.

    Raises:
        InvalidInput, Unsupported, LimitExceeded: as the reader of the format says.
    """
    if part.format == _PLY and part.runs is not None:
        table, found = _rows(part)
        first = part.runs[0][0]
        return table.columns.scene(found), np.arange(first, first + len(found))
    source = _source(part.name)
    scene = _whole(source, part)
    rows = streamed_sog.Part(PurePosixPath(part.name), part.runs).rows(source, len(scene))
    return (scene if part.runs is None else scene.take(rows)), rows


def read_positions(part: Part) -> F64:
    """(N, 3) float64 positions of the Gaussians of a part; of a PLY nothing else is taken from its rows.

    Raises:
        InvalidInput, Unsupported, LimitExceeded: as the reader of the format says.
    """
    if part.format != _PLY or part.runs is None:
        return read(part)[0].positions
    table, rows = _rows(part)
    return table.columns.positions(rows)


def _rows(part: Part) -> tuple[RowTable, ply.Rows]:
    """The rows of a part of a PLY."""
    assert part.runs is not None
    source = _source(part.name)
    table = RowTable.of(source)
    [(first, count)] = part.runs
    if table is None or first + count > table.count:
        raise source.corrupt("the file changed while it was read")
    return table, table.read(source, first, count)


def _whole(source: Source, part: Part) -> GaussianScene:
    if part.format == _SOG and isinstance(source, UrlInput) and part.name.endswith(".json"):
        with tempfile.TemporaryDirectory() as folder:
            return sog.load(FetchedSog(part.name, Path(folder)))
    scene = _format(source, part.format).importer.load(source)
    assert isinstance(scene, GaussianScene)
    return scene
