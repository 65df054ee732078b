"""Byte sources: exact ranges, honest counters, URLs by range requests."""

from __future__ import annotations

import re
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scarfmt.container.source import HEAD_BYTES, BytesSource, FileSource, UrlSource, open_source
from scarfmt.errors import InvalidInput, Truncated

CONTENT = bytes(i * 7 % 251 for i in range(3 * HEAD_BYTES))


@given(st.binary(max_size=40), st.integers(-3, 45), st.integers(-3, 45))
def test_bytes_source_gives_exact_ranges_or_truncated(data: bytes, offset: int, length: int) -> None:
    """Never fewer bytes than asked for, never an index error."""
    source = BytesSource(data)
    if offset >= 0 and length >= 0 and offset + length <= len(data):
        assert source.read(offset, length) == data[offset : offset + length]
    else:
        with pytest.raises(Truncated) as caught:
            source.read(offset, length)
        assert caught.value.refusal == "truncated-source"


def test_file_source_reads_only_what_is_asked(tmp_path: Path) -> None:
    """No whole-file read, no hidden buffering."""
    path = tmp_path / "content"
    path.write_bytes(CONTENT)
    with open_source(path) as source:
        assert isinstance(source, FileSource)
        assert source.read(100, 16) == CONTENT[100:116]
        assert source.read(5, 0) == b""
        assert (source.bytes_read, source.reads, source.size) == (16, 1, len(CONTENT))
        with pytest.raises(Truncated):
            source.read(len(CONTENT) - 1, 2)


def test_a_file_that_shrinks_while_open_is_truncated(tmp_path: Path) -> None:
    """A short read of the system is an error, not short data."""
    path = tmp_path / "content"
    path.write_bytes(CONTENT)
    with open_source(str(path)) as source:
        path.write_bytes(CONTENT[:10])
        with pytest.raises(Truncated):
            source.read(0, 11)


def test_missing_files_and_unknown_protocols_are_invalid_input(tmp_path: Path) -> None:
    """Opening fails with a message, not with a traceback of the operating system."""
    for origin in (tmp_path / "absent", f"file://{tmp_path}/absent", "nosuchprotocol://x"):
        with pytest.raises(InvalidInput) as caught:
            open_source(origin)
        assert caught.value.refusal == "input-source"


def test_bytes_of_any_kind_are_accepted() -> None:
    """bytes, bytearray and memoryview need no copy by the caller."""
    for data in (b"abc", bytearray(b"abc"), memoryview(b"abc")):
        assert open_source(data).read(1, 2) == b"bc"


class _Server(ThreadingHTTPServer):
    ranges = True
    requests: list[str]


class _Handler(BaseHTTPRequestHandler):
    server: _Server

    def do_HEAD(self) -> None:
        self._answer(False)

    def do_GET(self) -> None:
        self._answer(True)

    def _answer(self, body: bool) -> None:
        wanted = re.fullmatch(r"bytes=(\d+)-(\d+)", self.headers.get("Range", ""))
        data = CONTENT
        if wanted and self.server.ranges:
            data = CONTENT[int(wanted[1]) : int(wanted[2]) + 1]
        self.send_response(206 if wanted and self.server.ranges else 200)
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        if body:
            self.server.requests.append(self.headers.get("Range", ""))
            self.wfile.write(data)

    def log_message(self, format: str, *args: object) -> None:
        """Keep the test output quiet."""


@pytest.fixture
def server() -> Iterator[_Server]:
    """An HTTP server on this machine whose every path is CONTENT."""
    pytest.importorskip("aiohttp", reason="http sources need scarfmt[http]")
    instance = _Server(("127.0.0.1", 0), _Handler)
    instance.requests = []
    thread = threading.Thread(target=instance.serve_forever, args=(0.01,))
    thread.start()
    yield instance
    instance.shutdown()
    thread.join()
    instance.server_close()


def test_url_head_is_fetched_once_and_ranges_exactly(server: _Server) -> None:
    """Parsing a header costs one request; a far block costs its own bytes."""
    with open_source(f"http://127.0.0.1:{server.server_port}/scene.scar") as source:
        assert isinstance(source, UrlSource)
        assert source.size == len(CONTENT)
        assert source.read(0, 100) == CONTENT[:100]
        assert source.read(5000, 3000) == CONTENT[5000:8000]
        assert (source.reads, source.bytes_read) == (1, HEAD_BYTES)
        assert source.read(HEAD_BYTES - 10, 20) == CONTENT[HEAD_BYTES - 10 : HEAD_BYTES + 10]
        assert source.read(150_000, 1000) == CONTENT[150_000:151_000]
        assert (source.reads, source.bytes_read) == (3, HEAD_BYTES + 1020)
    assert len(server.requests) == 3


def test_a_server_without_ranges_is_asked_once(server: _Server) -> None:
    """It sends everything each time: the first answer must serve all later reads."""
    server.ranges = False
    source = open_source(f"http://127.0.0.1:{server.server_port}/scene.scar")
    assert source.read(100_000, 50) == CONTENT[100_000:100_050]
    assert source.read(0, 50) == CONTENT[:50]
    assert source.read(len(CONTENT) - 9, 9) == CONTENT[-9:]
    assert (source.reads, source.bytes_read) == (1, len(CONTENT))


def test_fsspec_protocols_work_without_a_network() -> None:
    """Anything fsspec knows is a source; here its in-memory file system."""
    import fsspec

    with fsspec.open("memory://scarfmt-test/content", "wb") as file:
        file.write(CONTENT)
    with open_source("memory://scarfmt-test/content") as source:
        assert source.read(len(CONTENT) - 5, 5) == CONTENT[-5:]
