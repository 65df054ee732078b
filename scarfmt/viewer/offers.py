"""What the server offers: scenes, by path or URL, and the files of the page."""

from __future__ import annotations

import gzip
import hashlib
import os
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path, PurePosixPath
from urllib.parse import quote, urlsplit

from scarfmt.container.source import ByteSource, FileSource
from scarfmt.errors import InvalidInput, Truncated

_PIECE_BYTES = 1 << 18
_COMPRESSED_FROM = 1000
"""Bytes; smaller files of the page are sent as they are."""
PAGE = files("scarfmt.viewer").joinpath("page")
"""The built page; `make web` writes it, and wheels contain it."""
_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".wasm": "application/wasm",
    ".txt": "text/plain; charset=utf-8",
    ".json": "application/json",
}
_BINARY = "application/octet-stream"


@dataclass(frozen=True)
class Version:
    """A file as it is now.

    Attributes:
        size: bytes.
        tag: strong validator, with quotes, as `ETag` has it: another one when the file is another.
        kind: media type.
    """

    size: int
    tag: str
    kind: str = _BINARY


@dataclass(frozen=True)
class FileOffer:
    """A scene on this machine. It is opened for each request, so that a file that is written anew is seen."""

    path: Path

    def version(self) -> Version:
        status = os.stat(self.path)
        return Version(status.st_size, f'"{status.st_ino:x}-{status.st_size:x}-{status.st_mtime_ns:x}"')

    def pieces(self, version: Version, first: int, end: int) -> Iterator[bytes]:
        """Bytes `first` to `end`; Truncated where the file is no longer of that version."""
        with FileSource(self.path) as source:
            if self.version() != version:
                raise Truncated("truncated-source", f"{self.path} was changed while it was read", offset=first)
            for start in range(first, end, _PIECE_BYTES):
                yield source.read(start, min(_PIECE_BYTES, end - start))


@dataclass
class SourceOffer:
    """A scene that is open: of a URL, which a page may then show whatever its own server permits, or of a pipe."""

    source: ByteSource
    name: str
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def version(self) -> Version:
        return Version(self.source.size, _digest(f"{self.name} {self.source.size}".encode()))

    def pieces(self, version: Version, first: int, end: int) -> Iterator[bytes]:
        """Bytes `first` to `end`."""
        with self._lock:
            data = self.source.read(first, end - first)
        yield data


@dataclass
class PageFile:
    """A file of the page, held in memory; `kind` is its media type."""

    data: bytes
    kind: str

    @cached_property
    def compressed(self) -> PageFile | None:
        """The file as gzip sends it, with the same media type; None where that is not worth it."""
        return PageFile(gzip.compress(self.data, mtime=0), self.kind) if len(self.data) >= _COMPRESSED_FROM else None

    def version(self) -> Version:
        return Version(len(self.data), _digest(self.data), self.kind)

    def pieces(self, version: Version, first: int, end: int) -> Iterator[bytes]:
        """Bytes `first` to `end`."""
        yield self.data[first:end]


Offer = FileOffer | SourceOffer | PageFile


def _digest(data: bytes) -> str:
    return f'"{hashlib.sha256(data).hexdigest()[:16]}"'


def page_offers(page: Traversable = PAGE) -> dict[str, Offer]:
    """Files of the page in a folder by path, ``/`` among them.

    Raises:
        InvalidInput: ``input-dependency`` where the page was never built.
    """
    if not page.joinpath("index.html").is_file():
        raise InvalidInput(
            "input-dependency", "the viewer page is not in this installation: `make web` builds it, and wheels have it"
        )
    offers: dict[str, Offer] = {
        f"/{file.name}": PageFile(file.read_bytes(), _TYPES.get(Path(file.name).suffix, _BINARY))
        for file in page.iterdir()
        if file.is_file()
    }
    offers["/"] = offers["/index.html"]
    return offers


def scene_offer(origin: str, number: int, source: ByteSource) -> tuple[str, Offer]:
    """The path at which a scene is offered, and the scene.

    Args:
        origin: path or URL, as typed.
        number: of the scene; two may have one name.
        source: what was opened for it. That of a file is closed: the file is opened again for each request.
    """
    name = PurePosixPath(urlsplit(origin).path).name if "://" in origin else Path(origin).name
    path = f"/scenes/{number}/{quote(name or 'scene.scar')}"
    if isinstance(source, FileSource):
        source.close()
        return path, FileOffer(Path(origin))
    return path, SourceOffer(source, origin)
