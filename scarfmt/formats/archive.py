"""Reading members of a ZIP archive without trusting what they claim to hold."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO

from scarfmt.errors import InvalidInput, LimitExceeded
from scarfmt.formats.source import Source

FREE_BYTES = 1 << 26
"""Any archive may unpack to so much: what it may unpack to beyond grows with its bytes."""

BYTES_PER_BYTE = 16
"""Bytes that members may unpack to together per byte of the archive, beyond `FREE_BYTES`. Trained arrays hardly shrink;
deflate would allow 1032."""

_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)


def is_zip(source: Source) -> bool:
    """Whether the content starts as a ZIP archive does."""
    return source.head(4) == b"PK\x03\x04"


class Archive:
    """An open ZIP archive; use :func:`open_archive`.

    Attributes:
        source: the file.
        members: what its directory says, by name.
    """

    def __init__(self, source: Source, archive: zipfile.ZipFile):
        self.source = source
        self.members = {info.filename: info for info in archive.infolist()}
        self._archive = archive
        self._left = FREE_BYTES + BYTES_PER_BYTE * source.size

    def read(self, name: str) -> bytes:
        """Content of one member, its CRC checked.

        Raises:
            InvalidInput: absent or damaged.
            LimitExceeded: ``input-limit``: the members read so far unpack to more than such an archive holds.
        """
        with self.open(name) as member:
            return member.read()

    @contextmanager
    def open(self, name: str) -> Iterator[IO[bytes]]:
        """One member as a stream; its CRC is checked when its last byte is read.

        Raises:
            InvalidInput: absent or damaged, also when reading the stream shows it.
            LimitExceeded: ``input-limit``: the members opened so far unpack to more than such an archive holds.
        """
        info = self.members.get(name)
        if info is None:
            raise self.source.corrupt("the archive lacks this member", field=name)
        self._left -= info.file_size
        if self._left < 0:
            message = f"{self.source.name}: {self.source.size} bytes that unpack to more than those of a scene would"
            raise LimitExceeded("input-limit", message, field=name)
        if info.compress_type not in _METHODS or info.flag_bits & 0x1:
            raise self.source.corrupt("encrypted, or neither stored nor deflated", field=name)
        try:
            with self._archive.open(info) as member:
                # zipfile never yields more than file_size, whatever the compressed data holds.
                yield member
        except InvalidInput:  # a ValueError too
            raise
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
