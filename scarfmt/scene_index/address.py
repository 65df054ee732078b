"""The address of an index and of the files that it names (R-17-7), which lie in its folder or below."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from types import TracebackType
from typing import Self
from urllib.parse import quote, urlsplit, urlunsplit

from scarfmt.container.header import read_header
from scarfmt.container.schema import CHECKSUM_SIZE
from scarfmt.container.source import ByteSource, Origin, open_source
from scarfmt.counters import Counters
from scarfmt.errors import InvalidInput, Malformed, ScarError
from scarfmt.limits import DEFAULT_LIMITS, Limits
from scarfmt.scene_index.document import Index, ListedFile, check_size, parse_index

Opener = Callable[[str], ByteSource]
_ENCODED = ("http", "https")
"""Protocols whose addresses are percent-encoded; others take names as they are."""


def beside(origin: str | os.PathLike[str], uri: str) -> str:
    """The path or URL of a file that the index at `origin` names."""
    if not isinstance(origin, str) or "://" not in origin:
        return os.path.join(os.path.dirname(os.path.abspath(origin)), *uri.split("/"))
    parts = urlsplit(origin)
    name = quote(uri) if parts.scheme in _ENCODED else uri
    return urlunsplit((parts.scheme, parts.netloc, f"{parts.path.rpartition('/')[0]}/{name}", "", ""))


def uri_of(path: Path, folder: Path) -> str:
    """The name that an index in `folder` has for the file at `path`.

    Raises:
        InvalidInput: ``input-scene``: the file is not in that folder or below.
    """
    # Of the folder links are followed, of the file not: an index names what lies beside it.
    inside = Path(os.path.realpath(path.parent)) / path.name
    try:
        return inside.relative_to(os.path.realpath(folder)).as_posix()
    except ValueError as error:
        message = f"{path} is not in the folder of the index, {folder}, or below: an index can name no other file"
        raise InvalidInput("input-scene", message) from error


def read_index(source: ByteSource) -> Index:
    """The index that a source holds.

    Raises:
        Malformed, Unsupported, LimitExceeded: it is refused (SPEC §17).
    """
    check_size(source.size)
    return parse_index(source.read(0, source.size))


def header_crc32(source: ByteSource, header_length: int) -> int:
    """The CRC-32 that a header ends with."""
    return int.from_bytes(source.read(header_length - CHECKSUM_SIZE, CHECKSUM_SIZE), "little")


class SceneFiles:
    """The files of a scene, each opened when it is needed: a context manager.

    Args:
        index: what is known of them.
        opener: opens the file of a uri.
        limits: what to accept of each file.
    """

    def __init__(self, index: Index, opener: Opener, limits: Limits = DEFAULT_LIMITS) -> None:
        self.index, self.limits, self._open = index, limits, opener

    def __len__(self) -> int:
        return len(self.index.files)

    @contextmanager
    def opened(self, number: int, counters: Counters | None = None) -> Iterator[ByteSource]:
        """One file, found to be the one that is listed (R-17-8). Errors say which file they are about.

        Args:
            number: of the file.
            counters: what it took to open it is added to them.

        Raises:
            InvalidInput: ``input-source``.
            Malformed: ``scene-file``, or its header is refused, as with Unsupported and LimitExceeded.
        """
        listed = self.index.files[number]
        with self.named(number), self._open(listed.uri) as source:
            self._check(listed, source)
            if counters is not None:
                counters.bytes_read += source.bytes_read
                counters.reads += source.reads
            yield source

    def named(self, number: int) -> AbstractContextManager[None]:
        """Errors of what is done meanwhile begin with the name of that file."""
        return naming(self.index.files[number].uri)

    def _check(self, listed: ListedFile, source: ByteSource) -> None:
        header = read_header(source, limits=self.limits, allow_truncated=True)
        different = listed.difference(header, header_crc32(source, header.header_length))
        for name in ("coordinate_frame", "colour_space"):
            if different is None and getattr(self.index, name) != getattr(header.fields, name):
                different = name
        if different is not None:
            message = f"not the file that the index lists: its {different} is another. Make the index anew"
            raise Malformed("scene-file", message, field=different)

    def close(self) -> None:
        """Nothing is open between two files."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class SingleFile(SceneFiles):
    """A scene of one file that is open already, and is closed with the scene.

    Args:
        index: what one would say of it.
        source: the file.
        limits: what to accept of it.
    """

    def __init__(self, index: Index, source: ByteSource, limits: Limits = DEFAULT_LIMITS) -> None:
        super().__init__(index, lambda _: source, limits)
        self.source = source

    @contextmanager
    def opened(self, number: int, counters: Counters | None = None) -> Iterator[ByteSource]:
        """The file, which was opened before."""
        yield self.source

    def named(self, number: int) -> AbstractContextManager[None]:
        """Nothing: it is clear which file errors are about."""
        return nullcontext()

    def close(self) -> None:
        """Close the file."""
        self.source.close()


def scene_files(
    origin: Origin, index: Index, *, opener: Opener | None = None, limits: Limits = DEFAULT_LIMITS
) -> SceneFiles:
    """The files of an index.

    Args:
        origin: path or URL of the index.
        index: what it says.
        opener: of files, by path or URL; None for :func:`~scarfmt.container.source.open_source`.
        limits: what to accept of each file.

    Raises:
        InvalidInput: ``input-scene`` for an index that has no place, such as one from a pipe.
    """
    if not isinstance(origin, str | os.PathLike) or origin == "-":
        raise InvalidInput("input-scene", "an index without a place: give its path or address, its files lie beside it")
    place, open_file = origin, opener or open_source
    return SceneFiles(index, lambda uri: open_file(beside(place, uri)), limits)


@contextmanager
def naming(uri: str) -> Iterator[None]:
    """Errors of what is done meanwhile begin with the name of a file."""
    try:
        yield
    except ScarError as error:
        message = f"{uri}: {error.message}"
        raise type(error)(error.refusal, message, offset=error.offset, field=error.field) from error
