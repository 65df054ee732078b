"""Writing a file whole or not at all."""

from __future__ import annotations

import contextlib
import os
import secrets
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
        force: replace an existing file.

    Raises:
        InvalidInput: the file exists and `force` is not set (refusal `output-exists`), or `path` cannot be written.
    """
    target = Path(os.path.realpath(path))
    if target.exists() and not target.is_file() and not target.is_dir():
        with target.open("wb") as device:
            yield device
        return
    _check_free(target, force)
    temporary = target.with_name(f".{target.name[:200]}.{secrets.token_hex(6)}.part")
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


def _create(temporary: Path, target: Path) -> BinaryIO:
    """Open a new file with the permissions any other new file would get."""
    try:
        return temporary.open("xb")
    except OSError as error:
        raise InvalidInput("output-path", f"cannot write {target}: {error.strerror}") from error
