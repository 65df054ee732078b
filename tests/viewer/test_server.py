"""The server of `scarfmt view`, asked over real sockets."""

from __future__ import annotations

import gzip
import http.client
import os
import threading
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote

import pytest

from scarfmt.container.source import BytesSource, FileSource
from scarfmt.viewer.offered import AssetOffer, FileOffer, SourceOffer, index_offers, page_offers, scene_offer
from scarfmt.viewer.server import ViewerServer, page_address, serve
from tests.scene_index.scenes import scene_folder

CONTENT = bytes(range(256)) * 4


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "a scene.scar"
    path.write_bytes(CONTENT)
    return path


@pytest.fixture
def server(scene: Path) -> Iterator[ViewerServer]:
    packed = AssetOffer(b"small", "text/javascript", "br")
    offers = {
        "/": AssetOffer(b"<!doctype html>", "text/html; charset=utf-8"),
        "/page.js": AssetOffer(CONTENT, "text/javascript", compressed={"br": packed}),
        "/file": FileOffer(scene),
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


@pytest.mark.parametrize("path", ["/file", "/remote"])
def test_without_a_range_all_is_sent(server: ViewerServer, path: str) -> None:
    status, headers, body = ask(server, path)
    assert (status, body, headers["Content-Length"]) == (200, CONTENT, str(len(CONTENT)))


def test_the_page_is_sent_compressed_to_browsers_that_take_it(server: ViewerServer) -> None:
    """The page has three megabytes, compressed one. A cached form must not be taken for the other."""
    status, packed, body = ask(server, "/page.js", Accept_Encoding="gzip, br")
    assert (status, body, packed["Content-Encoding"], packed["Vary"]) == (200, b"small", "br", "Accept-Encoding")
    status, plain, body = ask(server, "/page.js", Accept_Encoding="gzip")
    assert (status, body) == (200, CONTENT)
    assert "Content-Encoding" not in plain
    assert plain["ETag"] != packed["ETag"]


def test_ranges_and_scenes_are_never_compressed(server: ViewerServer) -> None:
    """Offsets are of the file itself."""
    assert ask(server, "/page.js", Accept_Encoding="br", Range="bytes=0-3")[2] == CONTENT[:4]
    assert ask(server, "/file", Accept_Encoding="br, gzip")[2] == CONTENT


def test_head_sends_no_body(server: ViewerServer) -> None:
    status, headers, body = ask(server, "/file", "HEAD")
    assert (status, body, headers["Content-Length"]) == (200, b"", str(len(CONTENT)))


def test_a_range_beyond_the_end_is_refused_with_the_size(server: ViewerServer) -> None:
    status, headers, _ = ask(server, "/file", Range="bytes=5000-")
    assert (status, headers["Content-Range"]) == (416, f"bytes */{len(CONTENT)}")


def test_a_file_written_anew_has_another_tag(server: ViewerServer, scene: Path) -> None:
    """A client that asks with If-Range must get the whole new file, never a part of it beside parts of the old one."""
    _, before, _ = ask(server, "/file", Range="bytes=0-0")
    assert ask(server, "/file", If_None_Match=before["ETag"])[0] == 304
    assert ask(server, "/file", Range="bytes=0-3", If_Range=before["ETag"])[0] == 206
    other = scene.with_name("other")
    other.write_bytes(CONTENT[::-1])
    os.replace(other, scene)
    status, after, body = ask(server, "/file", Range="bytes=0-3", If_Range=before["ETag"])
    assert after["ETag"] != before["ETag"]
    assert (status, body) == (200, CONTENT[::-1])


def test_a_file_that_is_gone_is_not_found(server: ViewerServer, scene: Path) -> None:
    scene.unlink()
    assert ask(server, "/file")[0] == 404


def test_only_what_is_offered_is_sent(server: ViewerServer, scene: Path) -> None:
    """Paths are names, not places on the disk."""
    for path in ("/nothing", "/../file", quote(str(scene)), "/file/../../etc/passwd"):
        assert ask(server, path)[0] == 404


def test_a_foreign_name_is_turned_away(server: ViewerServer) -> None:
    """A page on the web whose name resolves to 127.0.0.1 (DNS rebinding) must not read scenes."""
    port = server.server_address[1]
    assert ask(server, "/file", Host=f"attacker.example:{port}")[0] == 421
    assert ask(server, "/file", Host=f"localhost:{port}")[0] == 200


def test_a_query_is_for_the_page(server: ViewerServer) -> None:
    assert ask(server, "/?url=/file")[2] == b"<!doctype html>"
    assert page_address("http://h/", ["/scenes/0/a%20b.scar", "/scenes/1/c.scar"]) == (
        "http://h/?url=/scenes/0/a%2520b.scar&beside=/scenes/1/c.scar"
    )
    assert page_address("http://h/", []) == "http://h/"


def test_scenes_are_named_after_their_files(scene: Path) -> None:
    path, offer = scene_offer(str(scene), 3, FileSource(scene))
    assert path == "/scenes/3/a%20scene.scar"
    assert offer.version().size == len(CONTENT)
    path, offer = scene_offer("https://example.org/a/b.scar?key=1", 0, BytesSource(CONTENT))
    assert path == "/scenes/0/b.scar"
    version = offer.version()
    assert b"".join(offer.pieces(version, 3, 9)) == CONTENT[3:9]


def test_a_missing_page_says_how_to_get_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("scarfmt.viewer.offered.PAGE", tmp_path)
    with pytest.raises(ValueError, match="make web"):
        page_offers()


def test_every_file_of_the_page_is_offered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("index.html", "viewer.js", "viewer.js.br", "scar.wasm"):
        (tmp_path / name).write_bytes(name.encode())
    monkeypatch.setattr("scarfmt.viewer.offered.PAGE", tmp_path)
    offers = page_offers()
    assert set(offers) == {"/", "/index.html", "/viewer.js", "/scar.wasm"}
    assert offers["/scar.wasm"].version().kind == "application/wasm"
    script = offers["/viewer.js"]
    assert isinstance(script, AssetOffer)
    assert script.kind.startswith("text/javascript")
    assert {coding: (offer.data, offer.kind) for coding, offer in script.compressed.items()} == {
        "br": (b"viewer.js.br", script.kind)
    }


def test_what_is_not_compressed_beside_it_is_compressed_now(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A wheel has no compressed files beside the page. Small files are sent as they are."""
    (tmp_path / "index.html").write_bytes(b"small")
    (tmp_path / "viewer.js").write_bytes(b"large " * 1000)
    monkeypatch.setattr("scarfmt.viewer.offered.PAGE", tmp_path)
    offers = page_offers()
    script, page = offers["/viewer.js"], offers["/index.html"]
    assert isinstance(script, AssetOffer)
    assert isinstance(page, AssetOffer)
    assert gzip.decompress(script.compressed["gzip"].data) == script.data
    assert script.compressed["gzip"].version().coding == "gzip"
    assert page.compressed == {}


def test_ctrl_c_ends_serving_and_frees_the_port(monkeypatch: pytest.MonkeyPatch) -> None:
    server = ViewerServer({})

    def interrupted(_poll: float = 0.5) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(server, "serve_forever", interrupted)
    serve(server)
    assert server.socket.fileno() == -1


def test_the_files_of_an_index_are_found_at_their_names(tmp_path: Path) -> None:
    """However a browser encodes them; an index on this machine names files, one from elsewhere what is opened there."""
    path, source = scene_folder(tmp_path), "https://x.org/deep/scene.scar.json?token=1"
    (tmp_path / "deep" / "b.scar").rename(tmp_path / "deep" / "b (1)!.scar")
    path.write_bytes(path.read_bytes().replace(b"b.scar", b"b (1)!.scar"))
    asked: list[str] = []

    def opener(place: str) -> BytesSource:
        asked.append(place)
        return BytesSource(CONTENT)

    offers = {
        **index_offers(str(path), 0, FileSource(path), opener),
        **index_offers(source, 1, FileSource(path), opener),
    }
    assert (asked, list(offers)[::3]) == ([], ["/scenes/0/scene.scar.json", "/scenes/1/scene.scar.json"])
    with ViewerServer(offers) as serving:
        thread = threading.Thread(target=serving.serve_forever, daemon=True)
        thread.start()
        status, headers, body = ask(serving, "/scenes/0/scene.scar.json")
        assert (status, headers["Content-Type"], body) == (200, "application/json", path.read_bytes())
        for name in ("b%20(1)!.scar", "b%20%281%29%21.scar"):
            status, _, body = ask(serving, f"/scenes/0/deep/{name}", Range="bytes=0-3")
            assert (status, body) == (206, b"\x89SCA")
        assert ask(serving, "/scenes/1/a.scar")[2] == CONTENT
        assert ask(serving, "/scenes/1/a.scar", Range="bytes=1-1")[2] == b"\x01"
        assert asked == ["https://x.org/deep/a.scar"]
        assert ask(serving, "/scenes/0/%2e%2e/a.scar")[0] == 404
        serving.shutdown()
        thread.join()
