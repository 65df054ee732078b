"""Sources of the bytes of a scene (file, memory, members of a ZIP archive), with the errors and limits of importers."""

from __future__ import annotations

import json
import os
import re
import stat
import tempfile
import warnings
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path, PurePath, PurePosixPath
from typing import IO, Any, BinaryIO

from scarfmt.atomic import note_read
from scarfmt.errors import InputWarning, InvalidInput, LimitExceeded, Unsupported, file_error

MAX_GAUSSIANS = 1 << 27
"""Above any published scene; an import needs about 60 bytes of memory for each at SH degree 0."""

FREE_NUMBERS = 1 << 24
"""Any compressed file may unpack to so many: 284,000 Gaussians of SH degree 3, 1.2 million of degree 0."""

NUMBERS_PER_BYTE = 480
"""Maximum numbers for each byte of a compressed file, beyond `FREE_NUMBERS`. Trained scenes stay below 10; regular
ones, such as a plane of equal Gaussians, may reach 1000."""

MAX_JSON_BYTES = 1 << 28
"""Indices of the largest published scenes have 58 MB."""

GZIP = b"\x1f\x8b"
_PIECE = 1 << 16
_FAR = 1e30
_SURROGATE = re.compile("[\ud800-\udfff]")
_NO_WAITING = getattr(os, "O_NONBLOCK", 0)


class Source:
    """The bytes of one input, read only as far as needed.

    Args:
        origin: the path of a regular file, or the whole content of a file.
        label: the name of a content in messages, e.g. of the archive and the member it comes from.
        beside: content of the files in or below the folder of a content that comes from an archive, by their path.
    """

    def __init__(self, origin: Path | bytes, label: str = "", beside: dict[PurePosixPath, bytes] | None = None):
        self.path = origin if isinstance(origin, Path) else None
        self._data = origin if isinstance(origin, bytes) else None
        self._label = label
        self._files = beside or {}

    @property
    def name(self) -> str:
        """The name of this input in messages."""
        return str(self.path) if self.path is not None else self._label or "<bytes>"

    @property
    def file_name(self) -> str:
        """The name of the file without its folder; empty for bytes without a label."""
        return self._label.rpartition("/")[2] if self.path is None else self.path.name

    @cached_property
    def document(self) -> dict[str, Any] | None:
        """The JSON object that the content is; None for anything else."""
        if self.head(64).lstrip(b"\xef\xbb\xbf \t\r\n")[:1] != b"{":
            return None
        try:
            return self.json()
        except (InvalidInput, LimitExceeded):
            return None

    @property
    def size(self) -> int:
        """Length in bytes."""
        if self.path is None and self._data is not None:
            return len(self._data)
        assert self.path is not None
        try:
            return self.path.stat().st_size
        except (OSError, ValueError) as error:
            raise self._unreadable(error) from error

    def head(self, length: int) -> bytes:
        """The first `length` bytes, or fewer where the input is shorter."""
        if self._data is not None:
            return self._data[:length]
        with self.open() as stream:
            return stream.read(length)

    def read(self) -> bytes:
        """All bytes, kept for the next call."""
        if self._data is None:
            with self.open() as stream:
                self._data = stream.read()
        return self._data

    def json(self, text: bytes | memoryview | None = None, field: str | None = None) -> dict[str, Any]:
        """The object of a JSON document.

        Args:
            text: of a part of this input; None for all of it.
            field: the name of the part in messages.

        Raises:
            InvalidInput: ``input-corrupt``: it is no JSON, too deep, or no object.
            LimitExceeded: ``input-limit``: it is longer than that of any scene.
        """
        size = self.size if text is None else len(text)
        if size > MAX_JSON_BYTES:
            message = f"{self.name}: {size} bytes of JSON, above the limit of {MAX_JSON_BYTES >> 20} MiB"
            raise LimitExceeded("input-limit", message, field=field)
        try:
            document = json.loads(self.read() if text is None else bytes(text))
        except (ValueError, RecursionError) as error:
            raise self.corrupt(f"the JSON is damaged ({str(error)[:100]})", field=field) from error
        if not isinstance(document, dict):
            raise self.corrupt("the JSON is not an object", field=field)
        return document

    def member(self, holder: dict[str, Any], field: str) -> dict[str, Any]:
        """A member of an object of this input's JSON that is an object; empty where there is none."""
        value = holder.get(field, {})
        if not isinstance(value, dict):
            raise self.corrupt("expected a JSON object", field=field)
        return value

    def array(self, holder: dict[str, Any], field: str) -> list[Any]:
        """A member that is an array; empty where there is none."""
        value = holder.get(field, [])
        if not isinstance(value, list):
            raise self.corrupt("expected a JSON array", field=field)
        return value

    def natural(self, holder: dict[str, Any], field: str, default: int | None = None) -> int:
        """A member that is an integer of at least 0."""
        value = holder.get(field, default)
        if type(value) is not int or value < 0:
            raise self.corrupt(f"expected a number of at least 0, got {str(value)[:40]!r}", field=field)
        return value

    def vector(self, holder: dict[str, Any], field: str, default: Sequence[float]) -> list[float]:
        """A member that is as many finite numbers as its default has; the default where there is none."""
        value = holder.get(field)
        if value is None:
            return list(default)
        right = isinstance(value, list) and len(value) == len(default)
        if right and all(type(number) in (int, float) and abs(number) < _FAR for number in value):
            return [float(number) for number in value]
        raise self.corrupt(f"expected {len(default)} numbers", field=field)

    def beside(self, name: object, field: str) -> PurePosixPath:
        """The relative path of a file below the folder of this one, which the content names.

        A link is followed, as links are that people and caches make; what it leads to must be a regular file.

        Raises:
            InvalidInput: ``input-corrupt``: it is none, or leads elsewhere.
        """
        # Names with lone surrogates, which JSON can hold, or NUL are names of no file.
        given = name if isinstance(name, str) and "\0" not in name and not _SURROGATE.search(name) else ""
        path = PurePosixPath(given)
        if not path.name or path.is_absolute() or ".." in path.parts or {"\\", ":"} & set(str(path)):
            raise self.corrupt(f"{str(name)[:80]!r} is no relative path of a file", field=field)
        return path

    def file_beside(self, name: object, field: str) -> Source:
        """A file below the folder of this one, which the content names, as :meth:`beside` has it.

        Raises:
            InvalidInput: ``input-corrupt``; ``input-incomplete``: this was read from memory, and has no folder.
        """
        path = self.beside(name, field)
        if path in self._files:
            return Source(self._files[path], f"{self.name.rpartition('/')[0]}/{path}")
        if self.path is None:
            message = f"{self.name}: read from memory or an archive, it has no {path} beside it; give its path"
            raise InvalidInput("input-incomplete", message, field=field)
        return Source(self.path.parent / path)

    def open(self) -> BinaryIO:
        """A real binary file, so that it can be memory mapped; bytes are spilled to a temporary one."""
        if self.path is None:
            spill = tempfile.TemporaryFile()  # noqa: SIM115 - the caller closes it
            spill.write(self.read())
            spill.seek(0)
            return spill
        try:
            # Not to wait for the writer of a pipe; the files of a SOG directory may be anything.
            stream = open(self.path, "rb", opener=lambda path, flags: os.open(path, flags | _NO_WAITING))  # noqa: SIM115
        except (OSError, ValueError) as error:  # ValueError: a name with NUL or a lone surrogate
            raise self._unreadable(error) from error
        if not stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
            stream.close()
            raise InvalidInput("input-unreadable", f"{self.name}: not a regular file; copy its content to one")
        note_read(stream.fileno())
        return stream

    def corrupt(self, message: str, *, field: str | None = None, offset: int | None = None) -> InvalidInput:
        """The error for content that breaks its own format."""
        advice = "get an undamaged copy, or export the scene again"
        return InvalidInput("input-corrupt", f"{self.name}: {message}; {advice}", field=field, offset=offset)

    def warn(self, message: str) -> None:
        """Tell of something that does not stop the import."""
        warnings.warn(f"{self.name}: {message}", InputWarning, stacklevel=5)

    def check_count(self, count: int, *, sh_degree: int = 3, file_bytes: int | None = None) -> None:
        """Refuse a declared number of Gaussians before anything of that size is allocated.

        Args:
            count: as declared.
            sh_degree: of their spherical harmonics, as far as it is known.
            file_bytes: bytes of compressed data behind the count, where it is not this input's size.

        Raises:
            LimitExceeded: above MAX_GAUSSIANS, or more than so few bytes may unpack to.
        """
        if count > MAX_GAUSSIANS:
            raise LimitExceeded(
                "input-limit", f"{self.name}: declares {count} Gaussians, above the limit of {MAX_GAUSSIANS}"
            )
        size = self.size if file_bytes is None else file_bytes
        if count * (11 + 3 * (sh_degree + 1) ** 2) > FREE_NUMBERS + NUMBERS_PER_BYTE * size:
            message = f"declares {count} Gaussians in {size} bytes, more than this reader unpacks from so few"
            advice = "convert it to a PLY with the tool that wrote it"
            raise LimitExceeded("input-limit", f"{self.name}: {message}; {advice}")

    def _unreadable(self, error: OSError | ValueError) -> InvalidInput:
        reason = error.strerror if isinstance(error, OSError) else "no name of a file"
        message = f"{self.name}: {reason}; check the path and its permissions"
        return file_error("input-unreadable", message, error)


def gunzip(stream: BinaryIO, most: int) -> tuple[bytes, bool]:
    """What the members of a gzip file hold, one after the other; what follows the last is passed over, as gzip does.

    Args:
        stream: at the start of the first member.
        most: bytes to unpack, one more where there are more.

    Returns:
        The bytes, and whether they are all.

    Raises:
        zlib.error: damaged.
    """
    inflater, found, packed = zlib.decompressobj(wbits=31), bytearray(), stream.read(_PIECE)
    while packed and len(found) <= most:
        found += inflater.decompress(packed, most + 1 - len(found))
        packed = inflater.unconsumed_tail or stream.read(_PIECE)
        if inflater.eof:
            packed = inflater.unused_data + packed
            if not packed.startswith(GZIP):
                return bytes(found), len(found) <= most
            inflater = zlib.decompressobj(wbits=31)
    return bytes(found), False


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
        # zipfile takes the memory for a stored member before it reads what there is.
        if info.compress_size > self.source.size:
            raise self.source.corrupt("the member is longer than the archive", field=name)
        if info.compress_type not in _METHODS or info.flag_bits & 0x1:
            message = f"{self.source.name}: a member is encrypted, or neither stored nor deflated; unpack the archive"
            raise Unsupported("input-format", message, field=name)
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


def member_names(source: Source) -> tuple[str, ...]:
    """Names of the files in a ZIP archive, without those that macOS adds; none where it is no readable archive."""
    if not is_zip(source):
        return ()
    with source.open() as stream:
        try:
            with zipfile.ZipFile(stream) as archive:
                return tuple(name for name in archive.namelist() if not _is_added(name))
        except (zipfile.BadZipFile, NotImplementedError, OSError, ValueError):
            return ()


def _is_added(name: str) -> bool:
    return name.endswith("/") or "__MACOSX/" in name or PurePosixPath(name).name.startswith("._")


@dataclass(frozen=True)
class Folder:
    """A folder on disk or in a ZIP archive; use :func:`open_folder`.

    Attributes:
        place: the directory, or the path within the archive.
        archive: None on disk.
    """

    place: PurePath
    archive: Archive | None = None

    @property
    def size(self) -> int:
        """Bytes of the archive, or of the files in the directory."""
        if self.archive is not None:
            return self.archive.source.size
        return sum(path.stat().st_size for path in Path(self.place).iterdir() if path.is_file())

    def source(self, name: PurePath | str) -> Source:
        """A file in or below the folder.

        Raises:
            InvalidInput: the archive lacks it, or it is damaged.
            LimitExceeded: ``input-limit``: it unpacks to more than such an archive holds.
        """
        path = self.place / name
        if self.archive is None:
            return Source(Path(path))
        return Source(self.archive.read(str(path)), f"{self.archive.source.name}/{path}")

    def below(self, name: PurePath) -> Folder:
        """A folder in or below the folder."""
        return replace(self, place=self.place / name)


@contextmanager
def open_folder(source: Source, index: str) -> Iterator[tuple[Folder, Source]]:
    """The folder of an index, and the index.

    Args:
        source: the index in a directory, or a ZIP archive.
        index: the name of the index in an archive, where only one folder may have one.

    Raises:
        InvalidInput: ``input-incomplete``: an index from memory; ``input-format``: an archive of several scenes.
    """
    if not is_zip(source):
        if source.path is None:
            message = f"a {index} read from memory has no files beside it; give its path, or a bundled .sog"
            raise InvalidInput("input-incomplete", message)
        yield Folder(source.path.parent), source
        return
    found = [name for name in member_names(source) if PurePosixPath(name).name == index]
    if len(found) != 1:
        what = f"{len(found)} scenes, {', '.join(found[:3])}" if found else f"no {index}"
        raise InvalidInput("input-format", f"{source.name}: an archive with {what}; unpack it, and give one scene")
    with open_archive(source) as archive:
        folder = Folder(PurePosixPath(found[0]).parent, archive)
        yield folder, folder.source(index)
