"""The files that the server offers: scenes, by path or URL, and the files of the page."""

from __future__ import annotations

import gzip
import hashlib
import os
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path, PurePosixPath
from typing import Protocol
from urllib.parse import quote, urlsplit

from scarfmt.container.source import ByteSource, FileSource
from scarfmt.errors import InvalidInput, Truncated
from scarfmt.scene_index.address import beside
from scarfmt.scene_index.document import parse_index
from scarfmt.viewer.encodings import SUFFIXES

_PIECE_BYTES = 1 << 18
_LEAST_COMPRESSED = 1000
"""Bytes; smaller files are sent as they are."""
PAGE = files("scarfmt.viewer").joinpath("page")
"""The built page; `make web` puts it there, and it is in the wheel."""
_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".wasm": "application/wasm",
    ".svg": "image/svg+xml",
    ".txt": "text/plain; charset=utf-8",
    ".json": "application/json",
}
BINARY = "application/octet-stream"


@dataclass(frozen=True)
class Version:
    """A file as it is now.

    Attributes:
        size: bytes.
        tag: strong validator, with quotes, as `ETag` has it: another one when the file is another.
        kind: media type.
        coding: of its bytes, as `Content-Encoding` has it; None for none.
    """

    size: int
    tag: str
    kind: str
    coding: str | None = None


class Offer(Protocol):
    """Something that can be asked for."""

    def version(self) -> Version: ...

    def pieces(self, version: Version, first: int, end: int) -> Iterator[bytes]:
        """Bytes `first` to `end` of that version; Truncated where it is no longer there."""
        ...


@dataclass
class FileOffer:
    """A scene on this machine. It is opened for each request, so that a file that is written anew is seen."""

    path: Path

    def version(self) -> Version:
        status = os.stat(self.path)
        return Version(status.st_size, _tag(status), BINARY)

    def pieces(self, version: Version, first: int, end: int) -> Iterator[bytes]:
        with FileSource(self.path) as source:
            if _tag(os.stat(self.path)) != version.tag:
                raise Truncated("truncated-source", f"{self.path} was changed while it was read", offset=first)
            yield from _in_pieces(source, first, end)


@dataclass
class SourceOffer:
    """A scene that is open: of a URL, which a page may then show whatever its own server permits, or of a pipe."""

    source: ByteSource
    name: str
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def version(self) -> Version:
        digest = hashlib.sha256(f"{self.name} {self.source.size}".encode()).hexdigest()
        return Version(self.source.size, f'"{digest[:16]}"', BINARY)

    def pieces(self, version: Version, first: int, end: int) -> Iterator[bytes]:
        with self._lock:
            data = self.source.read(first, end - first)
        yield data


@dataclass
class LazyOffer:
    """A file of a scene at a URL, opened when it is first asked for: a scene may have thousands."""

    name: str
    opener: Callable[[str], ByteSource]
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _found: SourceOffer | None = None

    def version(self) -> Version:
        return self._offer().version()

    def pieces(self, version: Version, first: int, end: int) -> Iterator[bytes]:
        return self._offer().pieces(version, first, end)

    def _offer(self) -> SourceOffer:
        with self._lock:
            if self._found is None:
                self._found = SourceOffer(self.opener(self.name), self.name)
            return self._found


@dataclass(frozen=True)
class AssetOffer:
    """A file of the page, held in memory.

    Attributes:
        data: its bytes, coded where there is a `coding`.
        kind: media type of what they decode to.
        coding: as `Content-Encoding` has it.
        compressed: the same file by coding.
    """

    data: bytes
    kind: str
    coding: str | None = None
    compressed: Mapping[str, AssetOffer] = field(default_factory=dict)

    def version(self) -> Version:
        digest = hashlib.sha256(self.data).hexdigest()
        return Version(len(self.data), f'"{digest[:16]}"', self.kind, self.coding)

    def pieces(self, version: Version, first: int, end: int) -> Iterator[bytes]:
        yield self.data[first:end]


def _tag(status: os.stat_result) -> str:
    return f'"{status.st_ino:x}-{status.st_size:x}-{status.st_mtime_ns:x}"'


def _in_pieces(source: ByteSource, first: int, end: int) -> Iterator[bytes]:
    for start in range(first, end, _PIECE_BYTES):
        yield source.read(start, min(_PIECE_BYTES, end - start))


def page_offers() -> dict[str, Offer]:
    """Files of the page by path, ``/`` among them.

    Raises:
        InvalidInput: ``input-dependency`` where the page was never built.
    """
    if not PAGE.joinpath("index.html").is_file():
        raise InvalidInput(
            "input-dependency", "the viewer page is not in this installation: `make web` builds it, and wheels have it"
        )
    files = {asset.name: asset.read_bytes() for asset in PAGE.iterdir() if asset.is_file()}
    plain = [name for name in files if Path(name).suffix not in SUFFIXES.values()]
    offers: dict[str, Offer] = {f"/{name}": _asset(name, files) for name in plain}
    offers["/"] = offers["/index.html"]
    return offers


def _asset(name: str, files: Mapping[str, bytes]) -> AssetOffer:
    """A file of the page, and compressed: as `make web` put it beside, else made now, since wheels lack those."""
    data, kind = files[name], _TYPES.get(Path(name).suffix, BINARY)
    coded = {coding: files[name + suffix] for coding, suffix in SUFFIXES.items() if name + suffix in files}
    return _compressible(data, kind, coded)


def _compressible(data: bytes, kind: str, coded: Mapping[str, bytes] | None = None) -> AssetOffer:
    """A file, and compressed; by coding where that was done already."""
    if not coded and len(data) >= _LEAST_COMPRESSED:
        coded = {"gzip": gzip.compress(data, mtime=0)}
    compressed = {coding: AssetOffer(each, kind, coding) for coding, each in (coded or {}).items()}
    return AssetOffer(data, kind, compressed=compressed)


def scene_offer(origin: str, number: int, source: ByteSource) -> tuple[str, Offer]:
    """The path at which a scene is offered, and the scene.

    Args:
        origin: path or URL, as typed.
        number: of the scene; two may have one name.
        source: what was opened for it. That of a file is closed: the file is opened again for each request.
    """
    name = PurePosixPath(urlsplit(origin).path).name if "://" in origin else Path(origin).name
    if isinstance(source, FileSource):
        source.close()
        return _scene_path(number, name), FileOffer(Path(origin).resolve())
    return _scene_path(number, name), SourceOffer(source, origin)


def index_offers(
    origin: str, number: int, source: ByteSource, opener: Callable[[str], ByteSource]
) -> dict[str, Offer]:
    """The offers of an index, by path: first the index, then its files, at their names relative to it.

    Args:
        origin: path or URL of the index, as typed.
        number: of the scene.
        source: what was opened for it; it is closed.
        opener: of files that are not on this machine, when they are first asked for.

    Raises:
        InvalidInput: ``input-scene`` for an index without a place.
        Malformed, Unsupported, LimitExceeded: it is refused (SPEC §17).
    """
    with source:
        data = source.read(0, source.size)
        index = parse_index(data)
    remote = "://" in origin
    if not remote and origin == "-":
        raise InvalidInput("input-scene", "an index without a place: give its path or address, its files lie beside it")
    name = PurePosixPath(urlsplit(origin).path).name if remote else Path(origin).name
    path = _scene_path(number, name)
    out: dict[str, Offer] = {path: _compressible(data, _TYPES[".json"])}
    for file in index.files:
        place = beside(origin, file.uri)
        offer = LazyOffer(place, opener) if remote else FileOffer(Path(place))
        out[f"{path.rpartition('/')[0]}/{quote(file.uri)}"] = offer
    return out


def _scene_path(number: int, name: str) -> str:
    return f"/scenes/{number}/{quote(name or 'scene.scar')}"
