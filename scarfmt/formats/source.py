"""Sources of the bytes of a scene (a file or memory), and the errors and limits that all importers share."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path
from typing import BinaryIO

from scarfmt.errors import InvalidInput, LimitExceeded

MAX_GAUSSIANS = 1 << 27
"""Above any published scene; an import needs about 60 bytes of memory for each at SH degree 0."""

FREE_GAUSSIANS = 1 << 16
"""Any compressed file may declare so many: what it may declare beyond grows with its bytes."""

GAUSSIANS_PER_BYTE = 1
"""Maximum Gaussians for each byte of a compressed file, beyond `FREE_GAUSSIANS`. Real scenes stay below 0.1. It is also
the default of :class:`scarfmt.limits.Limits`. SPZ's own reader allows 1024 / 9, which costs 850 bytes of memory for
each byte."""

_NO_WAITING = getattr(os, "O_NONBLOCK", 0)


class Source:
    """The bytes of one input, read only as far as needed.

    Args:
        origin: the path of a regular file, or the whole content of a file.
    """

    def __init__(self, origin: Path | bytes):
        self.path = origin if isinstance(origin, Path) else None
        self._data = origin if isinstance(origin, bytes) else None

    @property
    def name(self) -> str:
        """The name of this input in messages."""
        return "<bytes>" if self.path is None else str(self.path)

    @property
    def file_name(self) -> str:
        """The name of the file without its folder; empty for bytes."""
        return "" if self.path is None else self.path.name

    @property
    def size(self) -> int:
        """Length in bytes."""
        return len(self._data) if self.path is None and self._data is not None else self._path_size()

    def head(self, length: int) -> bytes:
        """The first `length` bytes, or fewer where the input is shorter."""
        if self._data is not None:
            return self._data[:length]
        with self.open() as stream:
            return stream.read(length)

    def read(self) -> bytes:
        """All bytes, kept for the next call."""
        if self._data is None:
            with self.open() as stream:
                self._data = stream.read()
        return self._data

    def open(self) -> BinaryIO:
        """A real binary file, so that it can be memory mapped; bytes are spilled to a temporary one."""
        if self.path is None:
            spill = tempfile.TemporaryFile()  # noqa: SIM115 - the caller closes it
            spill.write(self.read())
            spill.seek(0)
            return spill
        try:
            # Not to wait for the writer of a pipe; the files of a SOG directory may be anything.
            stream = open(self.path, "rb", opener=lambda path, flags: os.open(path, flags | _NO_WAITING))  # noqa: SIM115
        except OSError as error:
            raise self._unreadable(error) from error
        if not stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
            stream.close()
            raise InvalidInput("input-unreadable", f"{self.name}: not a regular file; copy its content to one")
        return stream

    def corrupt(self, message: str, *, field: str | None = None, offset: int | None = None) -> InvalidInput:
        """The error for content that breaks its own format."""
        advice = "get an undamaged copy, or export the scene again"
        return InvalidInput("input-corrupt", f"{self.name}: {message}; {advice}", field=field, offset=offset)

    def check_count(self, count: int, *, file_bytes: int | None = None) -> None:
        """Refuse a declared number of Gaussians before anything of that size is allocated.

        Args:
            count: as declared.
            file_bytes: bytes of compressed data behind the count, where it is not this input's size.

        Raises:
            LimitExceeded: above MAX_GAUSSIANS.
            InvalidInput: more Gaussians than so few bytes hold in any real scene.
        """
        if count > MAX_GAUSSIANS:
            raise LimitExceeded(
                "input-limit", f"{self.name}: declares {count} Gaussians, above the limit of {MAX_GAUSSIANS}"
            )
        size = self.size if file_bytes is None else file_bytes
        if count > FREE_GAUSSIANS + GAUSSIANS_PER_BYTE * size:
            raise self.corrupt(f"declares {count} Gaussians in {size} bytes")

    def _path_size(self) -> int:
        assert self.path is not None
        try:
            return self.path.stat().st_size
        except OSError as error:
            raise self._unreadable(error) from error

    def _unreadable(self, error: OSError) -> InvalidInput:
        return InvalidInput("input-unreadable", f"{self.name}: {error.strerror}; check the path and its permissions")
