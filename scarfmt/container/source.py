"""Where file bytes come from: memory, a local file, or a URL read by byte ranges.

A reader asks a :class:`ByteSource` for exact ranges and trusts only its `size`. The counters say what was really
transferred, so tests and users can see that a partial read is partial.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, Self

from scarfmt.errors import InvalidInput, Truncated

HEAD_BYTES = 1 << 16
"""First request to a URL: one round trip brings the header and, for most scenes, tile table and directory."""


class ByteSource(Protocol):
    """Random access to the bytes of one file.

    Attributes:
        size: bytes in the source.
        bytes_read: bytes transferred so far, including read-ahead.
        reads: transfers (system calls or requests) so far.
    """

    size: int
    bytes_read: int
    reads: int

    def read(self, offset: int, length: int) -> bytes:
        """Exactly `length` bytes from `offset`; raises Truncated ``truncated-source`` where they do not exist."""
        ...

    def close(self) -> None: ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


class _Source:
    """Range check, counters and context manager shared by the sources; subclasses transfer bytes in `_fetch`."""

    def __init__(self, size: int) -> None:
        self.size = size
        self.bytes_read = 0
        self.reads = 0

    def _fetch(self, offset: int, length: int) -> bytes:
        raise NotImplementedError

    def _transfer(self, offset: int, length: int) -> bytes:
        data = self._fetch(offset, length)
        self.reads += 1
        self.bytes_read += len(data)
        return data

    def read(self, offset: int, length: int) -> bytes:
        """Exactly `length` bytes from `offset`.

        Raises:
            Truncated: ``truncated-source`` when the source does not have them.
        """
        if offset < 0 or length < 0 or offset + length > self.size:
            raise _short(offset, length, self.size)
        return self._transfer(offset, length) if length else b""

    def close(self) -> None:
        """Release the file handle, if there is one."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _short(offset: int, length: int, size: int) -> Truncated:
    return Truncated(
        "truncated-source", f"{length} bytes were asked for, but the source ends at byte {size}", offset=offset
    )


class BytesSource(_Source):
    """Bytes in memory."""

    def __init__(self, data: bytes | bytearray | memoryview) -> None:
        super().__init__(len(data))
        self._data = memoryview(data)

    def _fetch(self, offset: int, length: int) -> bytes:
        return bytes(self._data[offset : offset + length])


class FileSource(_Source):
    """A local file. Only asked-for ranges are read; safe to use from several threads.

    Raises:
        InvalidInput: ``input-source`` when the file cannot be opened.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        try:
            # Unbuffered: the buffer would read 8 KiB for a 16-byte range and make the counters wrong.
            self._file = Path(path).open("rb", buffering=0)  # noqa: SIM115
        except OSError as error:
            raise InvalidInput("input-source", f"cannot open {path}: {error.strerror}") from error
        self._lock = threading.Lock()
        super().__init__(os.fstat(self._file.fileno()).st_size)

    def _fetch(self, offset: int, length: int) -> bytes:
        parts: list[bytes] = []
        with self._lock:
            self._file.seek(offset)
            while length:
                part = self._file.read(length)
                if not part:
                    raise _short(offset, length, self._file.tell())
                parts.append(part)
                length -= len(part)
        return b"".join(parts)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _url_errors() -> tuple[type[Exception], ...]:
    try:
        from aiohttp import ClientError
    except ImportError:  # without scarfmt[http] there are no http transfers to fail
        return OSError, ValueError, ImportError
    return OSError, ValueError, ImportError, ClientError


class UrlSource(_Source):
    """A URL of any protocol fsspec knows, read by ranges.

    The first read within `HEAD_BYTES` brings all of them, kept for later; other reads transfer what they ask
    for. A server that ignores ranges sends the whole file: it is then kept and asked no more.

    Raises:
        InvalidInput: ``input-source`` when the URL cannot be opened, or its protocol needs a missing package.
    """

    def __init__(self, url: str) -> None:
        # Here and not above: importing them takes longer than decoding a small local file.
        from fsspec.core import url_to_fs

        self._errors = _url_errors()
        # A compressed transfer would make ranges and sizes count other bytes than the file's.
        options: dict[str, Any] = {"headers": {"Accept-Encoding": "identity"}} if url.startswith("http") else {}
        self._url = url
        self._head = b""
        try:
            self._fs, self._path = url_to_fs(url, **options)
            size = self._fs.size(self._path)
        except self._errors as error:
            raise InvalidInput("input-source", f"cannot open {url}: {error}") from error
        if size is None:
            raise InvalidInput("input-source", f"{url} does not tell its size: download it first")
        super().__init__(int(size))

    def _fetch(self, offset: int, length: int) -> bytes:
        try:
            return bytes(self._fs.cat_file(self._path, start=offset, end=offset + length))
        except self._errors as error:
            raise InvalidInput("input-source", f"reading {self._url} failed: {error}", offset=offset) from error

    def _transfer(self, offset: int, length: int) -> bytes:
        end = offset + length
        if end > len(self._head) and end <= HEAD_BYTES:
            self._head = self._checked(0, min(HEAD_BYTES, self.size))
        if end > len(self._head):
            data = self._checked(offset, length)
            if len(data) == length:
                return data
            self._head = data
        return self._head[offset:end]

    def _checked(self, offset: int, length: int) -> bytes:
        data = super()._transfer(offset, length)
        if len(data) not in (length, self.size):
            raise _short(offset, length, offset + len(data))
        return data


Origin = str | os.PathLike[str] | bytes | bytearray | memoryview | ByteSource
"""What a file can be read from: a path, a URL, its bytes, or a source that is open already."""


def open_source(origin: Origin) -> ByteSource:
    """The source for bytes, a path, or a URL (any string with ``://``); an open one is given back as it is.

    Use it as a context manager.

    Raises:
        InvalidInput: ``input-source`` when it cannot be opened.
    """
    if isinstance(origin, bytes | bytearray | memoryview):
        return BytesSource(origin)
    if isinstance(origin, str) and "://" in origin:
        return UrlSource(origin)
    if isinstance(origin, str | os.PathLike):
        return FileSource(origin)
    return origin


@contextmanager
def opened(origin: Origin) -> Iterator[ByteSource]:
    """The source of a path, URL or bytes, closed afterwards; a ByteSource is passed through and stays open.

    Raises:
        InvalidInput: ``input-source`` when it cannot be opened.
    """
    source = open_source(origin)
    if source is origin:
        yield source
        return
    with source:
        yield source
