"""Sources of file bytes: memory, a local file or a pipe. URLs are in :mod:`scarfmt.container.remote`.

A reader asks a :class:`ByteSource` for exact ranges and trusts only its `size`. The counters say what was really
transferred, so tests and users can see that a partial read is partial.
"""

from __future__ import annotations

import os
import stat
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Protocol, Self

from scarfmt.errors import InvalidInput, LimitExceeded, Truncated

HEAD_BYTES = 1 << 16
"""First request to a URL: one round trip brings header and directory, and of a small scene its first layer.
A smaller one would save at most as much, and cost a second round trip."""

COALESCE_BYTES = 1 << 22
"""Neighbouring pages or blocks are read in one request up to this size."""

TIMEOUT_SECONDS = 60.0
"""Time a request to a URL may take, besides that for its bytes."""

MAX_STREAM_BYTES = 1 << 30
"""Bytes taken from a pipe, all of which are held in memory: an endless one ends here."""

_PIECE_BYTES = 1 << 20


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


class RangeSource:
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
            raise short_source(offset, length, self.size)
        return self._transfer(offset, length) if length else b""

    def close(self) -> None:
        """Release the file handle, if there is one."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def short_source(offset: int, length: int, size: int) -> Truncated:
    """The error for `length` bytes at `offset` of a source that ends at byte `size`."""
    return Truncated(
        "truncated-source", f"{length} bytes were asked for, but the source ends at byte {size}", offset=offset
    )


class BytesSource(RangeSource):
    """Bytes in memory."""

    def __init__(self, data: bytes | bytearray | memoryview) -> None:
        super().__init__(len(data))
        self._data = memoryview(data)

    def _fetch(self, offset: int, length: int) -> bytes:
        return bytes(self._data[offset : offset + length])


class FileSource(RangeSource):
    """A local file. Only asked-for ranges are read; safe to use from several threads.

    Attributes:
        regular: whether it can be read by ranges. A pipe or a device cannot, and declares no size.

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
        status = os.fstat(self._file.fileno())
        self.regular = stat.S_ISREG(status.st_mode)
        super().__init__(status.st_size)

    def drained(self) -> BytesSource:
        """All bytes of a pipe or a device; closes it.

        Raises:
            LimitExceeded: ``input-limit`` beyond `MAX_STREAM_BYTES`.
        """
        with self._file as file:
            return BytesSource(read_bounded(file, file.name))

    def _fetch(self, offset: int, length: int) -> bytes:
        parts: list[bytes] = []
        with self._lock:
            self._file.seek(offset)
            while length:
                part = self._file.read(length)
                if not part:
                    raise short_source(offset, length, self._file.tell())
                parts.append(part)
                length -= len(part)
        return b"".join(parts)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def read_bounded(stream: BinaryIO, name: str, limit: int = MAX_STREAM_BYTES) -> bytes:
    """All bytes of a pipe or another stream without a size.

    Raises:
        LimitExceeded: ``input-limit`` beyond `limit` bytes.
    """
    parts: list[bytes] = []
    left = limit + 1
    while left and (part := stream.read(min(left, _PIECE_BYTES))):
        parts.append(part)
        left -= len(part)
    if not left:
        raise LimitExceeded("input-limit", f"{name} has more than {limit} bytes: save it to a file first")
    return b"".join(parts)


Origin = str | os.PathLike[str] | bytes | bytearray | memoryview | ByteSource
"""Anything that a file can be read from: a path, a URL, its bytes, or a source that is already open."""


def open_source(origin: Origin, *, timeout: float = TIMEOUT_SECONDS, head_bytes: int = HEAD_BYTES) -> ByteSource:
    """The source for bytes, a path, or a URL (any string with ``://``); an open one is given back as it is.

    Use it as a context manager.

    Args:
        origin: a path may name a pipe, which is then read to its end.
        timeout: of a URL, seconds for a request: see :class:`scarfmt.container.remote.UrlSource`.
        head_bytes: of a URL, size of the first request.

    Raises:
        InvalidInput: ``input-source`` when it cannot be opened; ``input-dependency`` when a package for URLs is
            missing.
        LimitExceeded: ``input-limit`` when a pipe holds more than `MAX_STREAM_BYTES`.
    """
    if isinstance(origin, bytes | bytearray | memoryview):
        return BytesSource(origin)
    if isinstance(origin, str) and "://" in origin:
        from scarfmt.container.remote import UrlSource

        return UrlSource(origin, timeout=timeout, head_bytes=head_bytes)
    if isinstance(origin, str | os.PathLike):
        source = FileSource(origin)
        return source if source.regular else source.drained()
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
