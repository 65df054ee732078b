"""Writing a file whole or not at all, and never over one that is read."""

from __future__ import annotations

import contextlib
import errno
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from os import PathLike
from pathlib import Path
from typing import BinaryIO

from scarfmt.errors import FileTaken, InvalidInput, file_error

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""What systems call a disk, a quota or a file that takes no more."""

Identity = tuple[int, int, str]
"""Device, number and "" of a file; of one that is not there yet, those of its folder, and its name."""
_INPUT, _OUTPUT = "is an input", "is another output"
_apart: ContextVar[dict[Identity, str] | None] = ContextVar("files that are read or being written", default=None)


@contextmanager
def keep_files_apart() -> Iterator[None]:
    """Within it, no file that was read is written, and no two that are open for writing are one.

    Files are compared by what they are: names, links and hard links of one file are the same.
    """
    before = _apart.set({})
    try:
        yield
    finally:
        _apart.reset(before)


def note_read(file: str | PathLike[str] | int) -> None:
    """Remember a file, by its name or number, as one that is read."""
    known = _apart.get()
    if known is not None:
        with contextlib.suppress(OSError, ValueError):
            status = os.stat(file)
            if stat.S_ISREG(status.st_mode):
                known[status.st_dev, status.st_ino, ""] = _INPUT


def _identity(target: Path) -> Identity:
    try:
        status, name = os.stat(target), ""
    except OSError:
        try:
            status, name = os.stat(target.parent), target.name
        except OSError:
            return -1, -1, str(target)
    return status.st_dev, status.st_ino, name


def _check_apart(target: Path, known: dict[Identity, str]) -> Identity:
    identity = _identity(target)
    if identity in known:
        raise InvalidInput("output-path", f"{target} {known[identity]}: give the output another name")
    return identity


@contextmanager
def atomic_write(path: str | PathLike[str], *, force: bool = False) -> Iterator[BinaryIO]:
    """A binary file that appears at `path` only when the block ends without an exception.

    It is written under a temporary name in the same directory, flushed to the disk, then renamed; on any exception,
    KeyboardInterrupt included, the temporary file is removed and `path` is as before. A device or pipe (`/dev/null`,
    say) is written directly.

    Args:
        path: destination; a symbolic link is followed, so that the link stays.
        force: replace an existing file, keeping its permissions, and its owner where the system allows that; but never
            an input (:func:`keep_files_apart`).

    Raises:
        InvalidInput: the file exists and `force` is not set (refusal `output-exists`), `path` cannot be written, or
            the disk is full (`output-full`).
    """
    target = Path(os.path.realpath(path))
    try:
        special = target.exists() and not target.is_file() and not target.is_dir()
    except OSError as error:  # a name that is too long
        raise file_error("output-path", f"cannot write {target}: {error.strerror}", error) from error
    if special:
        with target.open("wb") as device:
            yield device
        return
    known = _apart.get()
    known = {} if known is None else known
    _check_free(target, force)
    identity = _check_apart(target, known)
    known[identity] = _OUTPUT
    # Systems limit names to 255 bytes.
    shortened = os.fsencode(target.name)[:200].decode(errors="ignore")
    temporary = target.with_name(f".{shortened}.{os.urandom(6).hex()}.part")
    try:
        with _create(temporary, target) as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        _check_free(target, force)
        if known.get(identity) == _OUTPUT:  # else it was read since, as an input
            del known[identity]
        _check_apart(target, known)
        os.replace(temporary, target)
    except BaseException as error:
        if known.get(identity) == _OUTPUT:
            del known[identity]
        with contextlib.suppress(OSError):  # which would hide why there is none to remove
            temporary.unlink()
        if isinstance(error, OSError) and error.errno in FULL and error.filename in (None, str(temporary)):
            raise InvalidInput(
                "output-full", f"no space left for {target}; free some, or write it elsewhere"
            ) from error
        raise


def _check_free(target: Path, force: bool) -> None:
    if target.is_dir():
        raise InvalidInput("output-path", f"{target} is a directory; give a file name")
    if target.exists() and not force:
        raise FileTaken("output-exists", f"{target} exists")


def _create(temporary: Path, target: Path) -> BinaryIO:
    """Open a new file with the permissions of the file it will replace, or those any other new file would get."""
    try:
        replaced = os.stat(target) if target.exists() else None
        # What is private stays so also while it is written.
        mode = 0o666 if replaced is None else 0o600
        stream = open(temporary, "xb", opener=lambda path, flags: os.open(path, flags, mode))  # noqa: SIM115
    except OSError as error:
        raise file_error("output-path", f"cannot write {target}: {error.strerror}", error) from error
    if replaced is not None and hasattr(os, "fchmod"):
        # Only root may give a file away. The mode comes last: a change of owner may clear bits of it.
        with contextlib.suppress(OSError):
            os.fchown(stream.fileno(), replaced.st_uid, replaced.st_gid)
        with contextlib.suppress(OSError):
            os.fchmod(stream.fileno(), stat.S_IMODE(replaced.st_mode) & 0o777)
    return stream
