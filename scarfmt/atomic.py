"""Writing a file whole or not at all."""

from __future__ import annotations

import contextlib
import os
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import BinaryIO

from scarfmt.errors import InvalidInput


@contextmanager
def atomic_write(path: str | PathLike[str], *, force: bool = False) -> Iterator[BinaryIO]:
    """A binary file that appears at `path` only when the block ends without an exception.

    It is written under a temporary name in the same directory, flushed to the disk, then renamed; on any exception,
    KeyboardInterrupt included, the temporary file is removed and `path` is as before. A device or pipe (`/dev/null`,
    say) is written directly.

    Args:
        path: destination; a symbolic link is followed, so that the link stays.
        force: replace an existing file, keeping its permissions, and its owner where the system allows that.

    Raises:
        InvalidInput: the file exists and `force` is not set (refusal `output-exists`), or `path` cannot be written.
    """
    target = Path(os.path.realpath(path))
    if target.exists() and not target.is_file() and not target.is_dir():
        with target.open("wb") as device:
            yield device
        return
    _check_free(target, force)
    temporary = target.with_name(f".{_shortened(target.name)}.{secrets.token_hex(6)}.part")
    stream = _create(temporary, target)
    try:
        with stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        _check_free(target, force)
        os.replace(temporary, target)
    except BaseException:
        with contextlib.suppress(FileNotFoundError):
            temporary.unlink()
        raise


def _check_free(target: Path, force: bool) -> None:
    if target.is_dir():
        raise InvalidInput("output-path", f"{target} is a directory; give a file name")
    if target.exists() and not force:
        raise InvalidInput("output-exists", f"{target} exists; choose another name, or use force to overwrite it")


def _shortened(name: str) -> str:
    """The first 200 bytes of a file name, whole characters: systems limit names to 255 bytes."""
    return os.fsencode(name)[:200].decode(errors="ignore")


def _create(temporary: Path, target: Path) -> BinaryIO:
    """Open a new file with the permissions of the file it will replace, or those any other new file would get."""
    try:
        replaced = os.stat(target) if target.exists() else None
        # What is private stays so also while it is written.
        mode = 0o666 if replaced is None else 0o600
        stream = open(temporary, "xb", opener=lambda path, flags: os.open(path, flags, mode))  # noqa: SIM115
    except OSError as error:
        raise InvalidInput("output-path", f"cannot write {target}: {error.strerror}") from error
    if replaced is not None and hasattr(os, "fchmod"):
        # Only root may give a file away. The mode comes last: a change of owner may clear bits of it.
        with contextlib.suppress(OSError):
            os.fchown(stream.fileno(), replaced.st_uid, replaced.st_gid)
        with contextlib.suppress(OSError):
            os.fchmod(stream.fileno(), stat.S_IMODE(replaced.st_mode) & 0o777)
    return stream
