"""Sources of file bytes: memory, a local file, a pipe, or a URL read by byte ranges.

A reader asks a :class:`ByteSource` for exact ranges and trusts only its `size`. The counters say what was really
transferred, so tests and users can see that a partial read is partial.

URLs are read with bounded memory and time, whatever the server answers. http and https go through the session of
fsspec's file system, so that an answer is read piece by piece and no further than asked for. Other protocols go through
fsspec's plug-ins: they bound memory themselves, time is bounded here.
"""

from __future__ import annotations

import os
import re
import stat
import threading
from bisect import bisect_right
from collections.abc import Awaitable, Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, BinaryIO, TypeVar

from scarfmt.atomic import note_read
from scarfmt.errors import LimitExceeded, ScarError, Truncated, file_error, missing_package

if TYPE_CHECKING:
    from aiohttp import ClientResponse

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

SLOWEST_BYTES_PER_SECOND = 1 << 12
"""A request gets its timeout plus the time that its bytes take at this rate: a large block may arrive slowly, and a
server that sends a byte now and then comes to an end."""

WHOLE_ANSWER_BYTES = 1 << 28
"""Largest file taken from a server that ignores ranges: what was read of it stays in memory. As much as the default
limit of one block."""

_REDIRECTS = 10
_OK, _PARTIAL, _NO_SUCH_RANGE = 200, 206, 416

T = TypeVar("T")


class ByteSource(AbstractContextManager["ByteSource"]):
    """Random access to the bytes of one file: a subclass transfers them in `_fetch`.

    Attributes:
        size: bytes in the source.
        bytes_read: bytes transferred so far, including read-ahead.
        reads: transfers (system calls or requests) so far.
    """

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

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def short_source(offset: int, length: int, size: int) -> Truncated:
    """The error for `length` bytes at `offset` of a source that ends at byte `size`."""
    return Truncated(
        "truncated-source", f"{length} bytes were asked for, but the source ends at byte {size}", offset=offset
    )


class BytesSource(ByteSource):
    """Bytes in memory."""

    def __init__(self, data: bytes | bytearray | memoryview) -> None:
        super().__init__(len(data))
        self._data = memoryview(data)

    def _fetch(self, offset: int, length: int) -> bytes:
        return bytes(self._data[offset : offset + length])


class FileSource(ByteSource):
    """A local file. Only asked-for ranges are read; safe to use from several threads.

    Attributes:
        file: the open file.
        regular: whether it can be read by ranges. A pipe or a device cannot, and declares no size.

    Raises:
        InvalidInput: ``input-source`` when the file cannot be opened.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        try:
            # Unbuffered: the buffer would read 8 KiB for a 16-byte range and make the counters wrong.
            self.file = Path(path).open("rb", buffering=0)  # noqa: SIM115
        except OSError as error:
            raise file_error("input-source", f"cannot open {path}: {error.strerror}", error) from error
        self._lock = threading.Lock()
        status = os.fstat(self.file.fileno())
        self.regular = stat.S_ISREG(status.st_mode)
        note_read(self.file.fileno())
        super().__init__(status.st_size)

    def _fetch(self, offset: int, length: int) -> bytes:
        parts: list[bytes] = []
        with self._lock:
            self.file.seek(offset)
            while length:
                part = self.file.read(length)
                if not part:
                    raise short_source(offset, length, self.file.tell())
                parts.append(part)
                length -= len(part)
        return b"".join(parts)

    def close(self) -> None:
        """Close the file."""
        self.file.close()


class KeptSource(ByteSource):
    """What was read of another source is kept in memory, so that no byte of it is read twice.

    Args:
        source: the other, which stays open.
    """

    def __init__(self, source: ByteSource) -> None:
        super().__init__(source.size)
        self._source = source
        self._starts: list[int] = []
        self._kept: list[bytes] = []
        self._lock = threading.Lock()

    def _fetch(self, offset: int, length: int) -> bytes:
        parts: list[bytes] = []
        with self._lock:
            while length:
                place = bisect_right(self._starts, offset) - 1
                if place < 0 or self._starts[place] + len(self._kept[place]) <= offset:
                    place += 1
                    end = self._starts[place] if place < len(self._starts) else self.size
                    piece = self._source.read(offset, min(length, end - offset))
                    self._starts.insert(place, offset)
                    self._kept.insert(place, piece)
                first = offset - self._starts[place]
                parts.append(self._kept[place][first : first + length])
                offset, length = offset + len(parts[-1]), length - len(parts[-1])
        return b"".join(parts)


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


class UrlSource(ByteSource):
    """A URL of any protocol fsspec knows, read by ranges.

    Opening transfers the first `head_bytes`, which are kept: a later read transfers what it lacks of its range.
    A server that ignores ranges sends the whole file: it is read as far as asked for, and kept.

    Args:
        url: any string with ``://``.
        timeout: seconds that a request may take, besides its bytes at `SLOWEST_BYTES_PER_SECOND`.
        head_bytes: size of the first request.

    Raises:
        InvalidInput: ``input-source`` when the URL cannot be opened or read, with the reason; ``input-dependency``
            when fsspec or aiohttp is missing.
    """

    def __init__(self, url: str, *, timeout: float = TIMEOUT_SECONDS, head_bytes: int = HEAD_BYTES) -> None:
        self._url = url
        self._lock = threading.Lock()
        self._transport = _transport(url, timeout)
        size, self._head = self._attempt("open", None, lambda: self._transport.open(head_bytes))
        super().__init__(size)
        self.reads, self.bytes_read = 1, len(self._head)

    def _attempt(self, what: str, offset: int | None, act: Callable[[], T]) -> T:
        try:
            return act()
        except (ScarError, MemoryError):
            raise
        except Exception as error:  # plug-ins of fsspec raise whatever their libraries do
            raise file_error("input-source", f"cannot {what} {self._url}: {_reason(error)}", error, offset) from error

    def _fetch(self, offset: int, length: int) -> bytes:
        data = self._attempt("read", offset, lambda: self._transport.fetch(offset, length))
        if len(data) != length:
            raise short_source(offset, length, offset + len(data))
        return data

    def _transfer(self, offset: int, length: int) -> bytes:
        end = offset + length
        if self._transport.whole:
            with self._lock:
                if end > len(self._head):
                    self._head += super()._transfer(len(self._head), end - len(self._head))
        kept = len(self._head)
        if end <= kept:
            return self._head[offset:end]
        if offset >= kept:
            return super()._transfer(offset, length)
        return self._head[offset:] + super()._transfer(kept, end - kept)

    def close(self) -> None:
        """Close the connection, if one is held."""
        self._transport.close()


def _transport(url: str, timeout: float) -> _Plugin | _Http:
    try:
        import fsspec  # noqa: F401 - here and not above: importing it takes longer than decoding a small local file
    except ModuleNotFoundError as error:
        raise missing_package("fsspec", "http") from error
    if not re.match(r"https?://", url):
        return _Plugin(url, timeout)
    try:
        import aiohttp  # noqa: F401
    except ModuleNotFoundError as error:
        raise missing_package("aiohttp", "http") from error
    return _Http(url, timeout)


def _seconds(timeout: float, length: int) -> float:
    return timeout + length / SLOWEST_BYTES_PER_SECOND


def _reason(error: Exception) -> str:
    """Why a transfer failed, in a few words, also where the library's exception has none."""
    names = {kind.__name__ for kind in type(error).__mro__}
    if isinstance(error, TimeoutError):
        return "no complete answer in time (--timeout gives it more)"
    if "NonHttpUrlRedirectClientError" in names:
        return f"redirected to {error}, which is neither http nor https"
    if "TooManyRedirects" in names:
        return f"redirected more than {_REDIRECTS} times"
    if "InvalidURL" in names:
        return f"not a valid URL: {error}"
    if "IncompleteReadError" in names:
        return "the answer ends early"
    if isinstance(error, FileNotFoundError):
        return "there is no such file"
    return " ".join(str(error).split())[:200] or type(error).__name__  # one line: some quote the answer


class _Plugin:
    """A protocol other than http: fsspec's own reading, in a thread that is left behind when time is up.

    As with :class:`_Http`, `open` gives the size of the file and its first bytes, `fetch` some bytes, or fewer; any
    exception is a failure with a reason.
    """

    whole = False

    def __init__(self, url: str, timeout: float) -> None:
        self._url = url
        self._timeout = timeout
        self._file_system: Any = None
        self._path = ""

    def open(self, length: int) -> tuple[int, bytes]:
        return self._within(length, lambda: self._open(length))

    def _open(self, length: int) -> tuple[int, bytes]:
        from fsspec.core import url_to_fs

        self._file_system, self._path = url_to_fs(self._url)
        size = self._file_system.size(self._path)
        if size is None:
            raise ValueError("its size is unknown: download it first")
        return int(size), self._file_system.cat_file(self._path, start=0, end=min(length, int(size)))

    def fetch(self, offset: int, length: int) -> bytes:
        def read() -> bytes:
            return bytes(self._file_system.cat_file(self._path, start=offset, end=offset + length))

        return self._within(length, read)

    def _within(self, length: int, act: Callable[[], T]) -> T:
        from concurrent.futures import Future

        outcome: Future[T] = Future()

        def work() -> None:
            try:
                outcome.set_result(act())
            except BaseException as error:
                outcome.set_exception(error)

        # Not a pool: the interpreter would wait at its end for a thread that is stuck in a read.
        threading.Thread(target=work, daemon=True, name="scarfmt-url").start()
        return outcome.result(timeout=_seconds(self._timeout, length))

    def close(self) -> None:
        """Nothing is held open between reads."""


class _Http:
    """http and https: no more of an answer's body is read than was asked for.

    Attributes:
        whole: whether the server ignores ranges: `fetch` is then called for consecutive ranges alone.
    """

    def __init__(self, url: str, timeout: float) -> None:
        from fsspec.core import url_to_fs

        self.whole = False
        self._timeout = timeout
        self._url = url
        self._url_to_fs = url_to_fs
        self._size = 0
        self._response: ClientResponse | None = None

    def open(self, length: int) -> tuple[int, bytes]:
        self._file_system, _ = self._url_to_fs(self._url)
        return self._within(length, self._open(length))

    def fetch(self, offset: int, length: int) -> bytes:
        return self._within(length, self._fetch(offset, length))

    def _within(self, length: int, work: Awaitable[T]) -> T:
        import asyncio

        from fsspec.asyn import sync

        async def limited() -> T:
            async with asyncio.timeout(_seconds(self._timeout, length)):
                return await work

        result: T = sync(self._file_system.loop, limited)
        return result

    async def _get(self, first: int, last: int) -> ClientResponse:
        from aiohttp import ClientTimeout

        session = await self._file_system.set_session()
        # A compressed transfer would make ranges and sizes count other bytes than the file's.
        headers = {"Range": f"bytes={first}-{last}", "Accept-Encoding": "identity"}
        response: ClientResponse = await session.get(
            self._file_system.encode_url(self._url),
            headers=headers,
            timeout=ClientTimeout(total=None),
            max_redirects=_REDIRECTS,
        )
        if response.headers.get("Content-Encoding", "identity") != "identity":
            response.close()
            raise ValueError("the server sends it compressed: download it first")
        return response

    async def _open(self, length: int) -> tuple[int, bytes]:
        response = await self._get(0, length - 1)
        try:
            self._size = _size_of(response)
            self.whole = response.status == _OK
            if response.status == _NO_SUCH_RANGE:
                return 0, b""
            data = await _body(response, min(length, self._size))
        except BaseException:
            response.close()
            raise
        if self.whole:
            self._response = response
        else:
            response.close()
        return self._size, data

    async def _fetch(self, offset: int, length: int) -> bytes:
        if self._response is not None:
            return await _body(self._response, length)
        response = await self._get(offset, offset + length - 1)
        try:
            if _size_of(response) != self._size or response.status != _PARTIAL:
                raise ValueError("the file changed while it was read")
            if _first_of(response) != offset:
                raise ValueError("the server sent another part of the file than was requested")
            return await _body(response, length)
        finally:
            response.close()  # which keeps the connection where the answer ended here

    def close(self) -> None:
        if self._response is not None:
            self._file_system.loop.call_soon_threadsafe(self._response.close)


def _size_of(response: ClientResponse) -> int:
    """Bytes of the whole file, as the answer to a request for a range declares them.

    Raises:
        ValueError: the answer is a failure, or does not say.
    """
    content_range = response.headers.get("Content-Range", "")
    total = re.fullmatch(r"bytes (?:\d+-\d+|\*)/(\d{1,18})", content_range)
    if response.status == _PARTIAL and total:
        return int(total[1])
    if response.status == _NO_SUCH_RANGE and content_range == "bytes */0":
        return 0
    if response.status not in (_OK, _PARTIAL):
        raise ValueError(f"the server answered {response.status} {response.reason or ''}".rstrip())
    if response.status == _PARTIAL or response.content_length is None:
        raise ValueError("the server does not give the size of the file: download it first")
    if response.content_length > WHOLE_ANSWER_BYTES:
        raise ValueError(f"the server has no byte ranges, and sends {response.content_length} bytes: download it first")
    return response.content_length


def _first_of(response: ClientResponse) -> int:
    """First byte of the range that an answer brings, -1 where it does not say."""
    found = re.match(r"bytes (\d{1,18})-", response.headers.get("Content-Range", ""))
    return int(found[1]) if found else -1


async def _body(response: ClientResponse, length: int) -> bytes:
    """The next `length` bytes of an answer, or fewer where it ends."""
    from asyncio import IncompleteReadError

    try:
        return await response.content.readexactly(length)
    except IncompleteReadError as error:
        return error.partial


Origin = str | os.PathLike[str] | bytes | bytearray | memoryview | ByteSource
"""Anything that a file can be read from: a path, a URL, its bytes, or a source that is already open."""


def open_source(origin: Origin, *, timeout: float = TIMEOUT_SECONDS, head_bytes: int = HEAD_BYTES) -> ByteSource:
    """The source for bytes, a path, or a URL (any string with ``://``); an open one is given back as it is.

    Use it as a context manager.

    Args:
        origin: a path may name a pipe, which is then read to its end.
        timeout: of a URL, seconds for a request: see :class:`UrlSource`.
        head_bytes: of a URL, size of the first request.

    Raises:
        InvalidInput: ``input-source`` when it cannot be opened; ``input-dependency`` when a package for URLs is
            missing.
        LimitExceeded: ``input-limit`` when a pipe holds more than `MAX_STREAM_BYTES`.
    """
    if isinstance(origin, bytes | bytearray | memoryview):
        return BytesSource(origin)
    if isinstance(origin, str) and "://" in origin:
        return UrlSource(origin, timeout=timeout, head_bytes=head_bytes)
    if isinstance(origin, str | os.PathLike):
        source = FileSource(origin)
        if source.regular:
            return source
        with source.file as file:
            return BytesSource(read_bounded(file, file.name))
    return origin


@contextmanager
def use_source(origin: Origin) -> Iterator[ByteSource]:
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
