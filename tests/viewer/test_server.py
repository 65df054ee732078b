"""The server of `scarfmt view`, asked over real sockets."""

from __future__ import annotations

import base64
import gzip
import http.client
import io
import os
import threading
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote

import pytest

from scarfmt.container.source import BytesSource, FileSource
from scarfmt.errors import Truncated
from scarfmt.viewer import embedded
from scarfmt.viewer.offers import FileOffer, Offer, PageFile, SourceOffer, page_offers, scene_offer
from scarfmt.viewer.server import ViewerServer, accepts_gzip, parse_range, serve
from tests.samples.codec_samples import refuses

CONTENT = bytes(range(256)) * 4


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "a scene.scar"
    path.write_bytes(CONTENT)
    return path


@pytest.fixture
def server(scene: Path) -> Iterator[ViewerServer]:
    offers: dict[str, Offer] = {
        "/": PageFile(b"<!doctype html>", "text/html; charset=utf-8"),
        "/page.js": PageFile(CONTENT, "text/javascript"),
        "/file": FileOffer(scene),
        "/scenes/0/a%20%281%29.scar": FileOffer(scene),
        "/remote": SourceOffer(BytesSource(CONTENT), "https://example.org/a.scar"),
    }
    with ViewerServer(offers) as serving:
        thread = threading.Thread(target=serving.serve_forever, daemon=True)
        thread.start()
        yield serving
        serving.shutdown()
        thread.join()


Answer = tuple[int, dict[str, str], bytes]


def ask(server: ViewerServer, path: str, method: str = "GET", **headers: str) -> Answer:
    host, port = server.server_address[:2]
    connection = http.client.HTTPConnection(str(host), int(port), timeout=10)
    try:
        connection.request(method, path, headers={name.replace("_", "-"): value for name, value in headers.items()})
        reply = connection.getresponse()
        return reply.status, dict(reply.getheaders()), reply.read()
    finally:
        connection.close()


@pytest.mark.parametrize("path", ["/file", "/remote"])
def test_a_range_is_sent_alone(server: ViewerServer, path: str) -> None:
    """A viewer reads a scene by ranges: nothing else may be transferred, and the size must be given."""
    status, headers, body = ask(server, path, Range="bytes=10-19")
    assert (status, body) == (206, CONTENT[10:20])
    assert headers["Content-Range"] == f"bytes 10-19/{len(CONTENT)}"
    assert headers["Accept-Ranges"] == "bytes"


def test_the_page_is_sent_compressed_to_browsers_that_take_it(server: ViewerServer) -> None:
    """The page has three megabytes, compressed one. A cached form must not be taken for the other."""
    status, packed, body = ask(server, "/page.js", Accept_Encoding="gzip, br")
    assert (status, gzip.decompress(body), packed["Content-Encoding"]) == (200, CONTENT, "gzip")
    assert (packed["Vary"], packed["Content-Type"]) == ("Accept-Encoding", "text/javascript")
    status, plain, body = ask(server, "/page.js", Accept_Encoding="br")
    assert (status, body) == (200, CONTENT)
    assert "Content-Encoding" not in plain
    assert plain["ETag"] != packed["ETag"]


def test_ranges_and_scenes_are_never_compressed(server: ViewerServer) -> None:
    """Offsets are of the file itself."""
    assert ask(server, "/page.js", Accept_Encoding="gzip", Range="bytes=0-3")[2] == CONTENT[:4]
    assert ask(server, "/file", Accept_Encoding="br, gzip")[2] == CONTENT
    assert "Content-Encoding" not in ask(server, "/", Accept_Encoding="gzip")[1], "small files are sent as they are"


def test_head_sends_no_body(server: ViewerServer) -> None:
    """It would be taken for the beginning of the next answer."""
    connection = http.client.HTTPConnection(*server.server_address[:2], timeout=10)
    for method, body in (("HEAD", b""), ("GET", CONTENT)):
        connection.request(method, "/file")
        reply = connection.getresponse()
        assert (reply.status, reply.read(), reply.headers["Content-Length"]) == (200, body, str(len(CONTENT)))
    connection.close()


def test_a_range_beyond_the_end_is_refused_with_the_size(server: ViewerServer) -> None:
    status, headers, _ = ask(server, "/file", Range=f"bytes={len(CONTENT)}-")
    assert (status, headers["Content-Range"]) == (416, f"bytes */{len(CONTENT)}")


def test_a_file_written_anew_has_another_tag(server: ViewerServer, scene: Path) -> None:
    """A client that asks with If-Range must get the whole new file, never a part of it beside parts of the old one."""
    _, before, _ = ask(server, "/file", Range="bytes=0-0")
    assert ask(server, "/file", If_None_Match=before["ETag"])[0] == 304
    assert ask(server, "/file", Range="bytes=0-3", If_Range=before["ETag"])[0] == 206
    offer, other = FileOffer(scene), scene.with_name("other")
    version = offer.version()
    other.write_bytes(CONTENT[::-1])
    os.replace(other, scene)
    refuses("truncated-source", lambda: list(offer.pieces(version, 0, 4)), kind=Truncated)
    status, after, body = ask(server, "/file", Range="bytes=0-3", If_Range=before["ETag"])
    assert after["ETag"] != before["ETag"]
    assert (status, body) == (200, CONTENT[::-1])
    os.utime(scene, ns=(0, 0))
    assert ask(server, "/file", "HEAD")[1]["ETag"] != after["ETag"]


def test_a_file_that_is_gone_is_not_found(server: ViewerServer, scene: Path) -> None:
    scene.unlink()
    assert ask(server, "/file")[0] == 404


def test_a_file_that_fails_half_way_ends_the_connection(server: ViewerServer, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_arguments: object) -> None:
        raise Truncated("truncated-source", "gone")

    monkeypatch.setattr(FileOffer, "pieces", fail)
    with pytest.raises(http.client.IncompleteRead):
        ask(server, "/file")


def test_only_what_is_offered_is_sent(server: ViewerServer, scene: Path) -> None:
    """Paths are names, not places on the disk."""
    for path in ("/nothing", "/../file", quote(str(scene)), "/file/../../etc/passwd"):
        assert ask(server, path)[0] == 404
    assert ask(server, "/scenes/0/a%20(1).scar")[0] == 200, "however a browser encodes it"


def test_a_foreign_name_is_turned_away(server: ViewerServer) -> None:
    """A page on the web whose name resolves to 127.0.0.1 (DNS rebinding) must not read scenes."""
    port = server.server_address[1]
    assert ask(server, "/file", Host=f"attacker.example:{port}")[0] == 421
    for name in ("localhost", "127.9.9.9", "[::ffff:127.0.0.1]"):
        assert ask(server, "/file", Host=f"{name}:{port}")[0] == 200


@pytest.mark.parametrize("host", ["127.0.0.1", "127.0.0.2", "localhost"])
def test_all_of_the_loopback_network_is_this_machine(scene: Path, host: str) -> None:
    """By the address that is listened on, not by how it is written."""
    with ViewerServer({"/file": FileOffer(scene)}, host) as serving:
        assert serving.loopback_alone
    with ViewerServer({"/file": FileOffer(scene)}, "0.0.0.0") as serving:
        assert not serving.loopback_alone


@pytest.mark.parametrize("host", ["[", "[::1", "a]", "\x7f", "::::", "127.0.0.1.example.org", ""])
def test_a_host_that_is_none_is_refused_quietly(
    server: ViewerServer, capfd: pytest.CaptureFixture[str], host: str
) -> None:
    assert ask(server, "/file", Host=host)[0] == 421
    assert ask(server, "http://[", Host="localhost")[0] == 404
    assert capfd.readouterr().err == ""


def test_scenes_are_named_after_their_files(scene: Path) -> None:
    path, offer = scene_offer(str(scene), 3, FileSource(scene))
    assert path == "/scenes/3/a%20scene.scar"
    assert offer.version().size == len(CONTENT)
    path, offer = scene_offer("https://example.org/a/b.scar?key=1", 0, BytesSource(CONTENT))
    assert path == "/scenes/0/b.scar"
    assert scene_offer("https://example.org/", 1, BytesSource(CONTENT))[0] == "/scenes/1/scene.scar"
    version = offer.version()
    assert b"".join(offer.pieces(version, 3, 9)) == CONTENT[3:9]


def test_every_file_of_the_page_is_offered(tmp_path: Path) -> None:
    for name in ("index.html", "viewer.js", "scar.wasm"):
        (tmp_path / name).write_bytes(name.encode())
    offers = page_offers(tmp_path)
    kinds = {path: offer.version().kind for path, offer in offers.items()}
    assert kinds == {
        "/": "text/html; charset=utf-8",
        "/index.html": "text/html; charset=utf-8",
        "/viewer.js": "text/javascript; charset=utf-8",
        "/scar.wasm": "application/wasm",
    }


def test_ctrl_c_ends_serving_and_frees_the_port(monkeypatch: pytest.MonkeyPatch) -> None:
    server = ViewerServer({})

    def interrupted(_poll: float = 0.5) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(server, "serve_forever", interrupted)
    serve(server)
    assert server.socket.fileno() == -1


@pytest.mark.parametrize(
    ("header", "taken"),
    [
        *((taken, True) for taken in ("gzip, deflate, br", "GZip;q=0.5", "br;q=0, gzip;q=1.0", "br, gzip ; q=0.001")),
        *((other, False) for other in ("gzip;q=0", "gzip; q=0.000", "x-gzip", "br", "", None)),
    ],
)
def test_only_browsers_that_take_gzip_get_it(header: str | None, taken: bool) -> None:
    assert accepts_gzip(header) is taken


@pytest.mark.parametrize(
    ("header", "part"),
    [
        *(("bytes=0-9", (0, 10)), ("bytes=10-", (10, 100)), ("bytes=-7", (93, 100)), ("bytes=-700", (0, 100))),
        *(("bytes=90-1000", (90, 100)), ("bytes=99-99", (99, 100)), (" bytes=1-2 ", (1, 3))),
        *(("bytes=100-", (100, 100)), ("bytes=-0", (100, 100))),
        # RFC 9110 §14.2: a server may ignore a Range header; a wrong one must be.
        *((wrong, None) for wrong in (None, "", "bytes=", "bytes=-", "bytes=5-2", "bytes=0-1,4-5", "lines=0-1")),
        *((wrong, None) for wrong in ("bytes=a-b", "bytes=٣-٥", f"bytes=0-{'9' * 50}")),
    ],
)
def test_a_range_is_read_as_the_rfc_says(header: str | None, part: tuple[int, int] | None) -> None:
    assert parse_range(header, 100) == part


def test_a_page_of_one_file_holds_the_scene_with_a_name_that_ends_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "embedded.html").write_bytes(b"<body><!--scene--></body>")
    monkeypatch.setattr(embedded, "PAGE", tmp_path)
    data, target = bytes(range(256)) * (1 << 14) + b"!", io.BytesIO()
    size = embedded.write_page(BytesSource(data), '"><script>', target)
    head, scene, tail = target.getvalue().partition(base64.b64encode(data))
    assert (size, len(scene) > 0) == (len(target.getvalue()), True)
    assert head == b'<body><script type="text/plain" id="scene" title="&quot;&gt;&lt;script&gt;">'
    assert tail == b"</script></body>"
