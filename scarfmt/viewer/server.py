"""HTTP/1.1 with single ranges and strong validators, which is all that a streamed scene needs of a server."""

from __future__ import annotations

import contextlib
import ipaddress
import re
from collections.abc import Mapping, Sequence
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import quote, unquote, urlencode, urlsplit

from scarfmt.errors import ScarError
from scarfmt.viewer.offers import Offer, PageFile, Version

LOOPBACK = "127.0.0.1"
_IDLE_SECONDS = 60.0
_RANGE = re.compile(r"bytes=(\d{0,18})-(\d{0,18})", re.ASCII)
_GZIP = re.compile(r"(?:^|,)\s*gzip\s*(?:;\s*q\s*=\s*(?:1|0\.\d*[1-9])[\d.]*\s*)?(?:,|$)", re.IGNORECASE)


def parse_range(header: str | None, size: int) -> tuple[int, int] | None:
    """First byte and end of the part that a `Range` header asks for (RFC 9110 §14); None for the whole file.

    Several ranges, other units and what cannot be read are answered with the whole, as RFC 9110 §14.2 permits.

    Args:
        size: of the file, bytes.

    Returns:
        An end that is not above the first byte where nothing of the file lies in the range: status 416.
    """
    match = _RANGE.fullmatch(header.strip()) if header is not None else None
    if match is None or not (match[1] or match[2]):
        return None
    if not match[1]:
        first, end = max(0, size - int(match[2])), size
    else:
        first, end = int(match[1]), min(size, int(match[2]) + 1) if match[2] else size
        if match[2] and int(match[2]) < first:
            return None
    return first, end


def accepts_gzip(header: str | None) -> bool:
    """Whether an `Accept-Encoding` header (RFC 9110 §12.5.3) names gzip without refusing it."""
    return _GZIP.search(header or "") is not None


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
        # What it listens on, however the caller wrote it.
        self.loopback_alone = _is_loopback(str(self.server_address[0]))

    @property
    def url(self) -> str:
        """Address of the page, with the port that was free."""
        host, port = self.server_address[:2]
        name = host.decode() if isinstance(host, bytes) else host
        return f"http://{name}:{port}/"


def _is_loopback(host: str | None) -> bool:
    """Whether the name or address is of this machine alone, as the whole of 127.0.0.0/8 is."""
    if host == "localhost":
        return True
    try:
        address = ipaddress.ip_address(host or "")
    except ValueError:
        return False
    return (getattr(address, "ipv4_mapped", None) or address).is_loopback


def _parse_host(header: str) -> str | None:
    """The host of a `Host` header; None for one that names none."""
    try:
        return urlsplit(f"//{header}").hostname
    except ValueError:
        return None


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
        try:
            offer = self.server.offers.get(quote(unquote(urlsplit(self.path).path)))
        except ValueError:  # no URL
            offer = None
        if self.server.loopback_alone and not _is_loopback(_parse_host(self.headers.get("Host", ""))):
            self.send_error(HTTPStatus.MISDIRECTED_REQUEST, "this server answers to names of this machine alone")
        elif offer is None:
            self.send_error(HTTPStatus.NOT_FOUND)
        else:
            try:
                self._send(offer, with_body)
            except (ScarError, OSError):
                # Once bytes are on their way, a connection that ends early is the only way left to say so.
                self.close_connection = True

    def _send(self, offer: Offer, with_body: bool) -> None:
        # Ranges are always of the file itself.
        takes_gzip = "Range" not in self.headers and accepts_gzip(self.headers["Accept-Encoding"])
        compressed = offer.compressed if isinstance(offer, PageFile) and takes_gzip else None
        encoding = {"Content-Encoding": "gzip"} if compressed else {}
        offer = compressed or offer
        try:
            version = offer.version()
        except OSError:
            self.send_error(HTTPStatus.NOT_FOUND, "the file is gone")
            return
        if self.headers.get("If-None-Match") == version.tag:
            self._send_head(HTTPStatus.NOT_MODIFIED, version, encoding)
            return
        conditional = self.headers.get("If-Range")
        part = parse_range(self.headers.get("Range") if conditional in (None, version.tag) else None, version.size)
        first, end = part or (0, version.size)
        if part and first >= end:
            unknown = {"Content-Range": f"bytes */{version.size}", "Content-Length": "0"}
            self._send_head(HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE, version, unknown)
            return
        about = {"Content-Type": version.kind, "Content-Length": str(end - first), **encoding}
        if part:
            about["Content-Range"] = f"bytes {first}-{end - 1}/{version.size}"
        self._send_head(HTTPStatus.PARTIAL_CONTENT if part else HTTPStatus.OK, version, about)
        if with_body:
            for piece in offer.pieces(version, first, end):
                self.wfile.write(piece)

    def _send_head(self, status: HTTPStatus, version: Version, about: Mapping[str, str]) -> None:
        self.send_response(status)
        common = {"Accept-Ranges": "bytes", "ETag": version.tag, "Cache-Control": "no-cache", "Vary": "Accept-Encoding"}
        for name, value in {**common, **about}.items():
            self.send_header(name, value)
        self.end_headers()


def serve(server: ViewerServer) -> None:
    """Answer requests until interrupted."""
    with server, contextlib.suppress(KeyboardInterrupt):
        server.serve_forever()


def page_address(url: str, paths: Sequence[str]) -> str:
    """Address of the page at `url` with up to two scenes: the second is shown beside the first."""
    query = dict(zip(("url", "beside"), paths, strict=False))
    return f"{url}?{urlencode(query, safe='/')}" if query else url
