"""HTTP/1.1 with single ranges and strong validators, which is all that a streamed scene needs of a server."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import quote, unquote, urlencode, urlsplit

from scarfmt.errors import ScarError
from scarfmt.viewer.encodings import accepted
from scarfmt.viewer.offered import AssetOffer, Offer, Version
from scarfmt.viewer.ranges import Unsatisfiable, wanted

LOOPBACK = "127.0.0.1"
_ON_THIS_MACHINE = {LOOPBACK, "localhost", "::1"}
_IDLE_SECONDS = 60.0


class ViewerServer(ThreadingHTTPServer):
    """Serves `offers` by path.

    A request must name a host of this machine while the server listens on loopback alone: else any page on the web
    whose name resolves to this machine could read the scenes.

    Raises:
        OSError: the port is taken.
    """

    daemon_threads = True

    def __init__(self, offers: Mapping[str, Offer], host: str = LOOPBACK, port: int = 0) -> None:
        super().__init__((host, port), _Handler)
        self.offers = offers
        self.hosts = _ON_THIS_MACHINE if host in _ON_THIS_MACHINE else None

    @property
    def url(self) -> str:
        """Address of the page, with the port that was free."""
        host, port = self.server_address[:2]
        name = host.decode() if isinstance(host, bytes) else host
        return f"http://{f'[{name}]' if ':' in name else name}:{port}/"


class _Handler(BaseHTTPRequestHandler):
    server: ViewerServer
    protocol_version = "HTTP/1.1"
    server_version = "scarfmt"
    timeout = _IDLE_SECONDS

    def do_GET(self) -> None:
        self._answer(with_body=True)

    def do_HEAD(self) -> None:
        self._answer(with_body=False)

    def log_message(self, format: str, *args: object) -> None:
        """Requests are not logged: there are hundreds."""

    def _answer(self, with_body: bool) -> None:
        # Browsers and Python do not agree on which characters of a name are percent-encoded.
        offer = self.server.offers.get(quote(unquote(urlsplit(self.path).path)))
        if not self._is_for_us():
            self.send_error(HTTPStatus.MISDIRECTED_REQUEST, "this server answers to names of this machine alone")
        elif offer is None:
            self.send_error(HTTPStatus.NOT_FOUND)
        else:
            try:
                self._offer(self._coded(offer), with_body)
            except (ScarError, OSError):
                # Once bytes are on their way, a connection that ends early is the only way left to say so.
                self.close_connection = True

    def _is_for_us(self) -> bool:
        return self.server.hosts is None or urlsplit(f"//{self.headers.get('Host', '')}").hostname in self.server.hosts

    def _coded(self, offer: Offer) -> Offer:
        """The offer as the browser takes it; ranges are always of the file itself."""
        if not isinstance(offer, AssetOffer) or "Range" in self.headers:
            return offer
        coding = accepted(self.headers.get("Accept-Encoding"), offer.compressed)
        return offer if coding is None else offer.compressed[coding]

    def _offer(self, offer: Offer, with_body: bool) -> None:
        try:
            version = offer.version()
        except OSError:
            self.send_error(HTTPStatus.NOT_FOUND, "the file is gone")
            return
        if self.headers.get("If-None-Match") == version.tag:
            self._head(HTTPStatus.NOT_MODIFIED, version)
            return
        conditional = self.headers.get("If-Range")
        header = self.headers.get("Range") if conditional in (None, version.tag) else None
        try:
            part = wanted(header, version.size)
        except Unsatisfiable:
            self._head(
                HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE,
                version,
                {"Content-Range": f"bytes */{version.size}", "Content-Length": "0"},
            )
            return
        first, end = part or (0, version.size)
        about = {"Content-Type": version.kind, "Content-Length": str(end - first)}
        if part:
            about["Content-Range"] = f"bytes {first}-{end - 1}/{version.size}"
        self._head(HTTPStatus.PARTIAL_CONTENT if part else HTTPStatus.OK, version, about)
        if with_body:
            for piece in offer.pieces(version, first, end):
                self.wfile.write(piece)

    def _head(self, status: HTTPStatus, version: Version, about: Mapping[str, str] | None = None) -> None:
        self.send_response(status)
        headers = {"Accept-Ranges": "bytes", "ETag": version.tag, "Cache-Control": "no-cache", **(about or {})}
        headers["Vary"] = "Accept-Encoding"
        if version.coding is not None:
            headers["Content-Encoding"] = version.coding
        for name, value in headers.items():
            self.send_header(name, value)
        self.end_headers()


def serve(server: ViewerServer) -> None:
    """Answers until interrupted."""
    with server, contextlib.suppress(KeyboardInterrupt):
        server.serve_forever()


def page_address(url: str, paths: Sequence[str]) -> str:
    """The page at `url` with up to two scenes: the second is shown beside the first."""
    said = dict(zip(("url", "beside"), paths, strict=False))
    return f"{url}?{urlencode(said, safe='/')}" if said else url
