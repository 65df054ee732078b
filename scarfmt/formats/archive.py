"""Reading members of a ZIP archive without trusting what they claim to hold."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager

from scarfmt.errors import LimitExceeded
from scarfmt.formats.source import Source

MAX_MEMBER = 4 << 30
"""Bytes one member may unpack to."""

_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)


def is_zip(source: Source) -> bool:
    """Whether the content starts as a ZIP archive does."""
    return source.head(4) == b"PK\x03\x04"


class Archive:
    """An open ZIP archive; use :func:`open_archive`."""

    def __init__(self, source: Source, archive: zipfile.ZipFile):
        self.source = source
        self._archive = archive
        self.members = {info.filename: info for info in archive.infolist()}

    def read(self, name: str) -> bytes:
        """Content of one member, its CRC checked.

        Raises:
            InvalidInput: absent or damaged.
            LimitExceeded: it would unpack to more than MAX_MEMBER.
        """
        info = self.members.get(name)
        if info is None:
            raise self.source.corrupt("the archive lacks this member", field=name)
        if info.file_size > MAX_MEMBER:
            raise LimitExceeded("input-limit", f"{self.source.name}: unpacks to {info.file_size} bytes", field=name)
        if info.compress_type not in _METHODS or info.flag_bits & 0x1:
            raise self.source.corrupt("encrypted, or neither stored nor deflated", field=name)
        try:
            with self._archive.open(info) as member:
                # zipfile never yields more than file_size, whatever the compressed data holds.
                return member.read()
        except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, OSError, ValueError) as error:
            raise self.source.corrupt(f"damaged archive member ({error})", field=name) from error


@contextmanager
def open_archive(source: Source) -> Iterator[Archive]:
    """Open a ZIP archive.

    Raises:
        InvalidInput: not a ZIP archive, or its directory is damaged.
    """
    with source.open() as stream:
        try:
            archive = zipfile.ZipFile(stream)
        except (zipfile.BadZipFile, NotImplementedError, OSError, ValueError) as error:
            raise source.corrupt(f"damaged ZIP archive ({error})") from error
        with archive:
            yield Archive(source, archive)


def member_names(source: Source) -> frozenset[str]:
    """Names in a ZIP archive; none where the content is no readable ZIP archive."""
    if not is_zip(source):
        return frozenset()
    with source.open() as stream:
        try:
            with zipfile.ZipFile(stream) as archive:
                return frozenset(archive.namelist())
        except (zipfile.BadZipFile, NotImplementedError, OSError, ValueError):
            return frozenset()
