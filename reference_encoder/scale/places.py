"""Files and folders on this machine, or wherever fsspec reaches, by their paths or URLs."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from scarfmt.errors import InvalidInput, missing_package

_VERSIONS = ("size", "mtime", "LastModified", "Last-Modified", "ETag", "etag", "md5Hash", "generation", "content_md5")
"""Names that file systems have for a tag that changes with the content of a file."""


def is_url(name: str) -> bool:
    """True for a name that is a URL; any other is a path."""
    return "://" in name


def local_path(name: str) -> Path | None:
    """The path that a name stands for, None for a URL of elsewhere."""
    if name.startswith("file://"):
        return Path(name.removeprefix("file://"))
    return None if is_url(name) else Path(name)


def file_system(url: str) -> tuple[Any, str]:
    """The file system of fsspec for a URL, and the path of the URL in it.

    Raises:
        InvalidInput: ``input-dependency``, or ``input-source`` where it cannot be had.
    """
    try:
        from fsspec.core import url_to_fs
    except ModuleNotFoundError as error:
        raise missing_package("fsspec", "http") from error
    try:
        found: tuple[Any, str] = url_to_fs(url)
    except (ImportError, ValueError, OSError) as error:
        raise InvalidInput("input-source", f"cannot open {url}: {error}") from error
    return found


def is_folder(name: str) -> bool:
    """True where there is a folder of that name."""
    path = local_path(name)
    if path is not None:
        return path.is_dir()
    system, inside = file_system(name)
    return bool(system.isdir(inside))


def exists(name: str) -> bool:
    """True where there is a file or folder of that name."""
    path = local_path(name)
    if path is not None:
        return path.exists()
    system, inside = file_system(name)
    return bool(system.exists(inside))


def files_in(name: str) -> list[str]:
    """Names of what is in a folder, ascending."""
    path = local_path(name)
    if path is not None:
        return sorted(str(child) for child in path.iterdir())
    system, inside = file_system(name)
    return sorted(str(system.unstrip_protocol(child)) for child in system.ls(inside, detail=False))


def beside(name: str, other: str) -> str:
    """Resolve a relative name in a file: it lies beside that file."""
    path = local_path(name)
    if path is not None:
        return str(path.parent / other)
    return f"{name.rpartition('/')[0]}/{other}"


def version(name: str) -> dict[str, str]:
    """Tell one state of a file from another: its size, and when it was changed or a tag of its content.

    Raises:
        InvalidInput: ``input-source``: there is no such file.
    """
    path = local_path(name)
    try:
        if path is not None:
            status = os.stat(path)
            return {"size": str(status.st_size), "mtime": str(status.st_mtime_ns)}
        system, inside = file_system(name)
        found = system.info(inside)
    except OSError as error:
        raise InvalidInput("input-source", f"cannot open {name}: {error.strerror or error}") from error
    return {key: str(found[key]) for key in _VERSIONS if found.get(key) is not None}
