"""URLs: range requests, nothing transferred twice, and servers that err, lie, stall or never end."""

from __future__ import annotations

import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from scarfmt.container.source import HEAD_BYTES, WHOLE_ANSWER_BYTES, ByteSource, UrlSource, open_source
from scarfmt.errors import InvalidInput, ScarError, Truncated
from tests.samples.codec_samples import refuses

pytest.importorskip("fsspec", reason="URLs need the extra http")
pytest.importorskip("aiohttp", reason="URLs need the extra http")

CONTENT = bytes(i * 7 % 251 for i in range(3 * HEAD_BYTES))
TIMEOUT = 1.0
"""For servers that never answer: seconds until they are given up."""
LONGER = 6.0
"""For a server that answers at first, which a busy machine has to manage within that time."""
PATIENCE = 60.0
"""For servers that do answer: it is never used up."""


class _Handler(BaseHTTPRequestHandler):
    """Answers GET as the server's function says; HEAD is not supported, and not needed."""

    server: _Server

    def do_GET(self) -> None:
        self.server.requests.append(self.headers.get("Range", ""))
        try:
            self.server.answer(self)
        except OSError:  # the client has had enough
            self.close_connection = True

    def range(self) -> tuple[int, int]:
        """First and last byte asked for."""
        wanted = re.fullmatch(r"bytes=(\d+)-(\d+)", self.headers.get("Range", ""))
        assert wanted
        return int(wanted[1]), min(int(wanted[2]), len(CONTENT) - 1)

    def start(self, status: int, *headers: tuple[str, object]) -> None:
        self.send_response(status)
        for name, value in headers:
            self.send_header(name, str(value))
        self.end_headers()

    def partial(self, first: int, last: int, total: int = len(CONTENT)) -> None:
        self.start(206, ("Content-Range", f"bytes {first}-{last}/{total}"), ("Content-Length", last - first + 1))

    def send(self, data: bytes) -> None:
        # Before: a client that has all of an answer looks at the sum at once.
        self.server.sent += len(data)
        self.wfile.write(data)

    def log_message(self, format: str, *args: object) -> None:
        """Keep the test output quiet."""


Answer = Callable[[_Handler], None]


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False

    def __init__(self, answer: Answer) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.answer = answer
        self.requests: list[str] = []
        self.sent = 0
        self.done = threading.Event()
        self.url = f"http://127.0.0.1:{self.server_port}/scene.scar"


def ranges(to: _Handler) -> None:
    """The answer of a server without faults."""
    first, last = to.range()
    to.partial(first, last)
    to.send(CONTENT[first : last + 1])


def whole(to: _Handler) -> None:
    """A server without ranges."""
    to.start(200, ("Content-Length", len(CONTENT)))
    to.send(CONTENT)


@pytest.fixture
def serve() -> Iterator[Callable[[Answer], _Server]]:
    """Start a server on this machine."""
    servers: list[tuple[_Server, threading.Thread]] = []

    def start(answer: Answer) -> _Server:
        server = _Server(answer)
        thread = threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True)
        thread.start()
        servers.append((server, thread))
        return server

    yield start
    for server, thread in servers:
        server.done.set()
        server.shutdown()
        thread.join()
        server.server_close()


Serve = Callable[[Answer], _Server]


def open_url(server: _Server, timeout: float = PATIENCE, **options: int) -> ByteSource:
    return open_source(server.url, timeout=timeout, **options)


def test_what_has_come_is_not_asked_for_again(serve: Serve) -> None:
    """One request brings the head; a range that begins in it is asked for from where the head ends."""
    server = serve(ranges)
    with open_url(server) as source:
        assert isinstance(source, UrlSource)
        assert source.size == len(CONTENT)
        assert source.read(0, 100) == CONTENT[:100]
        assert source.read(5000, 3000) == CONTENT[5000:8000]
        assert (source.reads, source.bytes_read) == (1, HEAD_BYTES)
        assert source.read(HEAD_BYTES - 10, 20) == CONTENT[HEAD_BYTES - 10 : HEAD_BYTES + 10]
        assert source.read(150_000, 1000) == CONTENT[150_000:151_000]
        assert (source.reads, source.bytes_read) == (3, HEAD_BYTES + 1010)
    end = HEAD_BYTES - 1
    assert server.requests == [f"bytes=0-{end}", f"bytes={HEAD_BYTES}-{HEAD_BYTES + 9}", "bytes=150000-150999"]
    assert server.sent == HEAD_BYTES + 1010


def test_a_server_without_ranges_is_asked_once(serve: Serve) -> None:
    """Such a server sends everything each time, so the first answer must serve all later reads."""
    server = serve(whole)
    with open_url(server) as source:
        assert source.read(100_000, 50) == CONTENT[100_000:100_050]
        assert source.bytes_read == 100_050
        assert source.read(0, 50) == CONTENT[:50]
        assert source.read(len(CONTENT) - 9, 9) == CONTENT[-9:]
        assert source.bytes_read == len(CONTENT)
    assert len(server.requests) == 1


def test_an_empty_file_is_a_file_of_no_bytes(serve: Serve) -> None:
    """A server has no range to give of an empty file."""
    server = serve(lambda to: to.start(416, ("Content-Range", "bytes */0"), ("Content-Length", 0)))
    with open_url(server) as source:
        assert source.size == 0


def endless(to: _Handler) -> None:
    first, last = to.range()
    to.start(206, ("Content-Range", f"bytes {first}-{last}/{len(CONTENT)}"))
    while not to.server.done.is_set():
        to.send(CONTENT)


def endless_whole(to: _Handler) -> None:
    to.start(200, ("Content-Length", WHOLE_ANSWER_BYTES))
    while not to.server.done.is_set():
        to.send(CONTENT)


@pytest.mark.parametrize("answer", [endless, endless_whole])
def test_no_more_is_read_than_was_asked_for(serve: Serve, answer: Answer) -> None:
    """Bytes beyond the request stay in the buffers of the two systems, a few MiB."""
    server = serve(answer)
    with open_url(server) as source:
        assert source.read(10, 20) == CONTENT[10:30]
        assert source.read(HEAD_BYTES, 10) == CONTENT[:10] if answer is endless else True
        time.sleep(0.3)
    assert source.bytes_read <= HEAD_BYTES + 10
    assert server.sent < 64 << 20


def silent(to: _Handler) -> None:
    to.server.done.wait(20)


def stalling(to: _Handler) -> None:
    to.partial(*to.range())
    to.send(b"x" * 100)
    to.server.done.wait(20)


def dripping(to: _Handler) -> None:
    first, last = to.range()
    to.partial(first, last)
    for _ in range(first, last + 1):
        to.send(b"x")
        if to.server.done.wait(0.2):
            return


@pytest.mark.parametrize("answer", [silent, stalling, dripping])
def test_a_server_that_does_not_come_to_an_end_is_left(serve: Serve, answer: Answer) -> None:
    server = serve(answer)
    start = time.monotonic()
    refuses("input-source", lambda: open_url(server, TIMEOUT, head_bytes=2048), "no complete answer in time")
    assert time.monotonic() - start < 10  # a hang, not a slow machine, is what this tells apart


def test_a_read_is_bounded_in_time_as_opening_is(serve: Serve) -> None:
    server = serve(lambda to: ranges(to) if to.range()[0] == 0 else silent(to))
    with (
        open_url(server, LONGER) as source,
        pytest.raises(InvalidInput, match=r"cannot read .* no complete answer") as caught,
    ):
        source.read(HEAD_BYTES, 10)
    assert caught.value.offset == HEAD_BYTES


def chunked(to: _Handler) -> None:
    to.start(200, ("Transfer-Encoding", "chunked"))


def redirect(where: str) -> Answer:
    return lambda to: to.start(302, ("Location", where), ("Content-Length", 0))


def compressed(to: _Handler) -> None:
    to.start(200, ("Content-Length", 9), ("Content-Encoding", "gzip"))


FAILURES: dict[str, tuple[Answer, str]] = {
    "not found": (lambda to: to.start(404), "404 Not Found"),
    "server error": (lambda to: to.start(500), "500 Internal Server Error"),
    "no size": (chunked, "size"),
    "size unknown": (lambda to: to.start(206, ("Content-Range", "bytes 0-9/*"), ("Content-Length", 10)), "size"),
    "a part without a range": (lambda to: to.start(206, ("Content-Length", 10)), "size"),
    "too large without ranges": (lambda to: to.start(200, ("Content-Length", 1 << 40)), "no byte ranges"),
    "redirect to a file": (redirect("file:///etc/passwd"), "neither http nor https"),
    "redirect loop": (redirect("/scene.scar"), "redirected more than 10 times"),
    "compressed": (compressed, "compressed"),
}


@pytest.mark.parametrize("case", FAILURES)
def test_failures_give_their_reason(serve: Serve, case: str) -> None:
    answer, reason = FAILURES[case]
    server = serve(answer)
    with pytest.raises(InvalidInput, match=reason) as caught:
        open_url(server)
    assert caught.value.refusal == "input-source"
    assert f"cannot open {server.url}: " in caught.value.message


@pytest.mark.parametrize(
    ("url", "reason"),
    [
        ("http://127.0.0.1:1/x", "Connect call failed"),
        ("http://127.0.0.1:99999/x", "ort"),
        ("http://nosuchhost.invalid/x", "Cannot connect to host nosuchhost.invalid"),
        ("http://", "URL"),
        ("http://[::1", "Invalid IPv6 URL"),
        ("nosuchprotocol://x", "nosuchprotocol"),
        ("file:///no/such/file", "no such file"),
        ("memory://nothing", "no such file"),
        ("tar://x::file:///etc/passwd", ": invalid header"),
    ],
)
def test_addresses_that_lead_nowhere_give_their_reason(url: str, reason: str) -> None:
    refuses("input-source", lambda: open_source(url, timeout=10), reason)


def other_part(to: _Handler) -> None:
    first, last = to.range()
    shift = 7 * (first > 0)
    to.partial(first + shift, last + shift)
    to.send(CONTENT[first : last + 1])


def other_file(to: _Handler) -> None:
    first, last = to.range()
    to.partial(first, last, len(CONTENT) + (first > 0))
    to.send(CONTENT[first : last + 1])


def cut(to: _Handler) -> None:
    first, last = to.range()
    to.start(206, ("Content-Range", f"bytes {first}-{last}/{len(CONTENT)}"))
    to.send(CONTENT[first : last + 1 - (first > 0)])


@pytest.mark.parametrize(
    ("answer", "error", "reason"),
    [
        (other_part, InvalidInput, "another part"),
        (other_file, InvalidInput, "changed"),
        (lambda to: ranges(to) if to.range()[0] == 0 else to.start(503), InvalidInput, "503"),
        (lambda to: ranges(to) if to.range()[0] == 0 else whole(to), InvalidInput, "changed"),
        (cut, Truncated, "ends at byte"),
    ],
)
def test_a_wrong_later_answer_is_an_error_and_never_wrong_bytes(
    serve: Serve, answer: Answer, error: type[ScarError], reason: str
) -> None:
    with open_url(serve(answer)) as source, pytest.raises(error, match=reason):
        source.read(100_000, 50)


def test_fsspec_protocols_work_without_a_network(tmp_path: Path) -> None:
    """Anything fsspec knows is a source; here its in-memory file system, and files."""
    import fsspec

    with fsspec.open("memory://scarfmt-test/content", "wb") as file:
        file.write(CONTENT)
    (tmp_path / "content").write_bytes(CONTENT)
    for url in ("memory://scarfmt-test/content", f"file://{tmp_path}/content"):
        with open_source(url) as source:
            assert source.read(len(CONTENT) - 5, 5) == CONTENT[-5:]
            assert source.bytes_read == HEAD_BYTES + 5


def test_a_plug_in_that_hangs_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    from fsspec.implementations.memory import MemoryFileSystem

    hang = threading.Event()
    monkeypatch.setattr(MemoryFileSystem, "size", lambda _self, _path: hang.wait(20))
    with pytest.raises(InvalidInput, match="no complete answer in time"):
        open_source("memory://scarfmt-test/content", timeout=0.2, head_bytes=10)
    hang.set()


@pytest.mark.parametrize(
    ("missing", "works"), [("fsspec", ("FILE", "bytes")), ("aiohttp", ("FILE", "bytes", "file://FILE"))]
)
def test_without_the_packages_for_urls_all_else_works(tmp_path: Path, missing: str, works: tuple[str, ...]) -> None:
    """A URL is refused with the name of the extra to install."""
    path = tmp_path / "content"
    path.write_bytes(b"abc")
    origins = [b"abc" if origin == "bytes" else origin.replace("FILE", str(path)) for origin in works]
    script = f"""
import sys
sys.modules[{missing!r}] = None
from scarfmt.container.source import open_source
from scarfmt.errors import InvalidInput
for origin in {origins!r}:
    with open_source(origin) as source:
        assert source.read(0, 3) == b"abc"
try:
    open_source("http://127.0.0.1:1/x")
except InvalidInput as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.startswith(f"input-dependency: this needs the package {missing}: ")
    assert "[http]" in done.stdout
