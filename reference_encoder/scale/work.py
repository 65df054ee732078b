"""The directory in which an out-of-core encoder keeps what it has: files that appear whole, on a disk or at a URL."""

from __future__ import annotations

import errno
import pickle
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from reference_encoder.scale.places import file_system, local_path
from scarfmt.atomic import atomic_write
from scarfmt.container.source import opened
from scarfmt.errors import InvalidInput

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_UNFINISHED = ".part"


@dataclass(frozen=True)
class Work:
    """A directory, created where it is first written to. Its files are trusted: some are pickles.

    Attributes:
        place: path or URL.
    """

    place: str

    def path(self, name: str) -> str:
        """Path or URL of a file."""
        return f"{self.place.rstrip('/')}/{name}"

    @contextmanager
    def write(self, name: str) -> Iterator[BinaryIO]:
        """A binary file that appears under its name only when it is whole; it replaces one that is there.

        Raises:
            InvalidInput: ``work-full``: the disk is full. What was there before is still there.
        """
        try:
            with self._local(name) if local_path(self.place) is not None else self._remote(name) as stream:
                yield stream
        except OSError as error:
            if error.errno not in _FULL:
                raise
            message = f"no space left for {self.path(name)}; free some, and give the same command with --resume"
            raise InvalidInput("work-full", message) from error

    @contextmanager
    def _local(self, name: str) -> Iterator[BinaryIO]:
        path = _path(self.path(name))
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path, force=True) as stream:
            yield stream

    @contextmanager
    def _remote(self, name: str) -> Iterator[BinaryIO]:
        system, path = file_system(self.path(name))
        system.makedirs(path.rpartition("/")[0], exist_ok=True)
        temporary = f"{path}.{secrets.token_hex(6)}{_UNFINISHED}"
        try:
            with system.open(temporary, "wb") as stream:
                yield stream
            system.mv(temporary, path)
        except BaseException:
            with suppress(FileNotFoundError):
                system.rm(temporary)
            raise

    def read(self, name: str) -> bytes:
        """All of a file.

        Raises:
            InvalidInput: ``input-source``: there is none.
        """
        with opened(self.origin(name)) as source:
            return source.read(0, source.size)

    def read_ranges(self, name: str, ranges: list[tuple[int, int]]) -> list[bytes]:
        """Some bytes of a file, each given by offset and length.

        Raises:
            InvalidInput: ``input-source``: there is none.
        """
        with opened(self.origin(name)) as source:
            return [source.read(offset, length) for offset, length in ranges]

    def origin(self, name: str) -> str:
        """Give what a source of bytes opens to read a file."""
        path = local_path(self.path(name))
        return self.path(name) if path is None else str(path)

    def put(self, name: str, value: Any) -> None:
        """Keep a Python object."""
        with self.write(name) as stream:
            pickle.dump(value, stream, protocol=5)

    def get(self, name: str) -> Any:
        """The object kept under a name."""
        return pickle.loads(self.read(name))

    def names(self, folder: str = "") -> set[str]:
        """Bare names of the whole files in a folder; none where there is no such folder."""
        return {name for name in self._all(folder) if not name.endswith(_UNFINISHED)}

    def tidy(self, folder: str) -> None:
        """Remove what a process left behind that was ended while it wrote."""
        for name in self._all(folder):
            if name.endswith(_UNFINISHED):
                self.remove(f"{folder}/{name}")

    def remove(self, name: str) -> None:
        """Remove a file.

        Raises:
            FileNotFoundError: there is none at a URL.
        """
        path = local_path(self.path(name))
        if path is not None:
            path.unlink(missing_ok=True)
        else:
            system, inside = file_system(self.path(name))
            system.rm(inside)

    def _all(self, folder: str) -> list[str]:
        path = local_path(self.path(folder))
        try:
            if path is not None:
                return [child.name for child in path.iterdir() if child.is_file()]
            system, inside = file_system(self.path(folder))
            return [child.rpartition("/")[2] for child in system.ls(inside, detail=False)]
        except (FileNotFoundError, NotADirectoryError):
            return []


def _path(name: str) -> Path:
    path = local_path(name)
    assert path is not None
    return path
