"""Where a scene's bytes come from (a file or memory), and the errors and limits all importers share."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import BinaryIO

from scarfmt.errors import InvalidInput, LimitExceeded

MAX_GAUSSIANS = 1 << 27
"""Above any published scene; an import needs about 60 bytes of memory for each at SH degree 0."""

_DENSEST = 1024 / 9
"""Gaussians per file byte no compressor of real scenes comes near: the bound SPZ's reference reader uses."""


class Source:
    """The bytes of one input, read only as far as needed.

    Args:
        origin: a path, or the whole content of a file.
    """

    def __init__(self, origin: Path | bytes):
        self.path = origin if isinstance(origin, Path) else None
        self._data = origin if isinstance(origin, bytes) else None

    @property
    def name(self) -> str:
        """What messages call this input."""
        return "<bytes>" if self.path is None else str(self.path)

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
            return self.path.open("rb")
        except OSError as error:
            raise self._unreadable(error) from error

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
            InvalidInput: more Gaussians than so few bytes can hold.
        """
        if count > MAX_GAUSSIANS:
            raise LimitExceeded(
                "input-limit", f"{self.name}: declares {count} Gaussians, above the limit of {MAX_GAUSSIANS}"
            )
        size = self.size if file_bytes is None else file_bytes
        if count > size * _DENSEST:
            raise self.corrupt(f"declares {count} Gaussians in {size} bytes")

    def _path_size(self) -> int:
        assert self.path is not None
        try:
            return self.path.stat().st_size
        except OSError as error:
            raise self._unreadable(error) from error

    def _unreadable(self, error: OSError) -> InvalidInput:
        return InvalidInput("input-unreadable", f"{self.name}: {error.strerror}; check the path and its permissions")
