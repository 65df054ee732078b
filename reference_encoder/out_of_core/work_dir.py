"""The directory in which an out-of-core encoder keeps finished work: whole files, a plan and a lock; also at a URL.

The plan names everything that the result depends on. The result of a task is a file, written last: it stands for all
that the task left. Nothing in them is run (:mod:`reference_encoder.kept_values`).
"""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import socket
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

import numpy as np

from reference_encoder import kept_values
from scarfmt.atomic import FULL
from scarfmt.container.source import use_source
from scarfmt.errors import InvalidInput, missing_package

PLAN, LOCK = "plan.json", "in-use.json"
_UNFINISHED = ".part"
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


def file_system(name: str) -> tuple[Any, str]:
    """The file system of fsspec for a path or URL, and the path of it in that system.

    Raises:
        InvalidInput: ``input-dependency``, or ``input-source`` where it cannot be had.
    """
    try:
        from fsspec.core import url_to_fs
    except ModuleNotFoundError as error:
        raise missing_package("fsspec", "http") from error
    try:
        found: tuple[Any, str] = url_to_fs(name)
    except (ImportError, ValueError, OSError) as error:
        raise InvalidInput("input-source", f"cannot open {name}: {error}") from error
    return found


def is_folder(name: str) -> bool:
    """True where there is a folder of that name."""
    system, inside = file_system(name)
    return bool(system.isdir(inside))


def exists(name: str) -> bool:
    """True where there is a file or folder of that name."""
    system, inside = file_system(name)
    return bool(system.exists(inside))


def list_folder(name: str) -> list[str]:
    """Names of what is in a folder, ascending."""
    system, inside = file_system(name)
    children = system.ls(inside, detail=False)
    return sorted(str(child if local_path(name) else system.unstrip_protocol(child)) for child in children)


def resolve_beside(name: str, other: str) -> str:
    """Resolve a relative name that a file holds: it lies beside that file."""
    path = local_path(name)
    return f"{name.rpartition('/')[0]}/{other}" if path is None else str(path.parent / other)


def file_version(name: str) -> dict[str, str]:
    """Size of a file, and when it was changed or a tag of its content: they tell one state of it from another.

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


def content_version(name: str) -> dict[str, str]:
    """Digest of the content of a file on this machine, which another size or date does not change; of one at a URL, as
    :func:`file_version`.

    Raises:
        InvalidInput: ``input-source``: there is no such file.
    """
    path = local_path(name)
    if path is None:
        return file_version(name)
    try:
        with path.open("rb") as stream:
            return {"sha256": hashlib.file_digest(stream, "sha256").hexdigest()}
    except OSError as error:
        raise InvalidInput("input-source", f"cannot open {name}: {error.strerror or error}") from error


def file_name(folder: str, number: int) -> str:
    """The name of a file of which every range has one."""
    return f"{folder}/{number:06}"


@dataclass(frozen=True)
class WorkDir:
    """A directory, created where it is first written to.

    Attributes:
        place: path or URL.
    """

    place: str

    def path(self, name: str) -> str:
        """Path or URL of a file."""
        return f"{self.place.rstrip('/')}/{name}"

    @contextmanager
    def write(self, name: str) -> Iterator[BinaryIO]:
        """A binary file that appears under its name only when it is whole; it replaces one that is there.

        Raises:
            InvalidInput: ``work-full``: the disk is full. What was there before is still there.
        """
        system, path = file_system(self.path(name))
        temporary = f"{path}.{secrets.token_hex(6)}{_UNFINISHED}"
        try:
            system.makedirs(path.rpartition("/")[0], exist_ok=True)
            with system.open(temporary, "wb") as stream:
                yield stream
            system.mv(temporary, path)
        except BaseException as error:
            with suppress(OSError):
                system.rm(temporary)
            if isinstance(error, OSError) and error.errno in FULL:
                raise self._full(name) from error
            raise

    def _full(self, name: str) -> InvalidInput:
        message = f"no space left for {self.path(name)}; free some, and give the same command with --resume"
        return InvalidInput("work-full", message)

    def read(self, name: str) -> bytes:
        """All of a file.

        Raises:
            InvalidInput: ``input-source``: there is none.
        """
        with use_source(self.origin(name)) as source:
            return source.read(0, source.size)

    def read_ranges(self, name: str, ranges: list[tuple[int, int]]) -> list[bytes]:
        """Some bytes of a file, each given by offset and length.

        Raises:
            InvalidInput: ``input-source``: there is none.
        """
        with use_source(self.origin(name)) as source:
            return [source.read(offset, length) for offset, length in ranges]

    def origin(self, name: str) -> str:
        """Path or URL with which a source of bytes reads a file."""
        path = local_path(self.path(name))
        return self.path(name) if path is None else str(path)

    def put(self, name: str, value: Any) -> None:
        """Keep a value, of the kinds that :mod:`reference_encoder.kept_values` knows."""
        with self.write(name) as stream:
            for piece in kept_values.pack(value):
                stream.write(piece)

    def get(self, name: str) -> Any:
        """The value kept under a name.

        Raises:
            InvalidInput: ``work-damaged``; ``input-source``: there is none.
        """
        try:
            return kept_values.unpack(self.read(name))
        except ValueError as error:
            raise self._damaged(name, error) from error

    def _damaged(self, name: str, error: ValueError) -> InvalidInput:
        message = (
            f"{self.path(name)} is no file that this version wrote whole ({error}); give another directory to --work"
        )
        return InvalidInput("work-damaged", message)

    def names(self, folder: str = "") -> set[str]:
        """Bare names of the whole files in a folder; none where there is no such folder."""
        return {name for name in self._list(folder) if not name.endswith(_UNFINISHED)}

    def remove_unfinished(self) -> None:
        """Remove what a process left behind that was ended while it wrote."""
        system, inside = file_system(self.place)
        for path in system.find(inside):
            if path.endswith(_UNFINISHED):
                system.rm(path)

    def _remove(self, name: str) -> None:
        system, inside = file_system(self.path(name))
        system.rm(inside)

    def _list(self, folder: str, *kinds: str) -> list[str]:
        system, inside = file_system(self.path(folder))
        try:
            found = system.ls(inside, detail=True)
        except (FileNotFoundError, NotADirectoryError):
            return []
        return [child["name"].rpartition("/")[2] for child in found if child["type"] in (kinds or ("file",))]

    @contextmanager
    def lock(self) -> Iterator[None]:
        """Have the directory for one encoding. On a POSIX disk the system lets go of it when the process ends.

        Raises:
            InvalidInput: ``work-in-use``: another process works there, or did so at a URL and left its file.
        """
        path = local_path(self.path(LOCK))
        with self._lock_remote() if path is None or os.name != "posix" else self._lock_local(path):
            yield

    @contextmanager
    def _lock_local(self, path: Path) -> Iterator[None]:
        import fcntl  # POSIX only

        # Opened to append: the file is not emptied before it is held. It stays, because a process that removes a file
        # which others may hold makes two of it.
        with ExitStack() as stack:
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                file = stack.enter_context(path.open("a+b", buffering=0))
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                file.truncate(0)
                file.write(_owner())
            except BlockingIOError:
                self._refuse(path.read_bytes(), ", or end it")
            except OSError as error:
                raise (self._full(LOCK) if error.errno in FULL else error) from error
            yield

    @contextmanager
    def _lock_remote(self) -> Iterator[None]:
        if LOCK in self.names():
            self._refuse(self.read(LOCK), f"; if it has ended, remove {self.path(LOCK)}")
        with self.write(LOCK) as file:
            file.write(_owner())
        try:
            yield
        finally:
            with suppress(FileNotFoundError):
                self._remove(LOCK)

    def _refuse(self, owner: bytes, advice: str) -> NoReturn:
        try:
            found = json.loads(owner)
            who = f"process {int(found['process'])} of {found['host']}"
        except (ValueError, KeyError, TypeError):
            who = "another process"
        message = f"{self.place} is in use by {who}: wait for it{advice}; or give another directory to --work"
        raise InvalidInput("work-in-use", message)

    def begin(self, plan: Mapping[str, Any], resume: bool) -> None:
        """Take the directory for a plan.

        Args:
            plan: all that the result depends on, by name, as :func:`describe` gives it.
            resume: whether to go on with finished work of the same plan.

        Raises:
            InvalidInput: ``work-exists``: there is work and `resume` is not set; ``work-plan``: the work is of another
                plan, the message says what differs, or of none; ``work-damaged``.
        """
        if PLAN not in self.names():
            others = [name for name in self._list("", "file", "directory") if name[0] != "." and name != LOCK]
            if others:
                message = f"{self.place} holds {min(others)} but no {PLAN}: nothing tells what it is of"
                raise InvalidInput("work-plan", f"{message}; give an empty or a new directory to --work")
            with self.write(PLAN) as stream:
                stream.write(json.dumps(plan, indent=1).encode())
            return
        if not resume:
            message = f"{self.place} holds an encoding: --resume goes on with it; or give another directory to --work"
            raise InvalidInput("work-exists", message)
        try:
            begun = dict(json.loads(self.read(PLAN)))
        except (ValueError, TypeError) as error:
            raise self._damaged(PLAN, ValueError(error)) from error
        differs = sorted(name for name in {*begun, *plan} if begun.get(name) != plan.get(name))
        if differs:
            message = f"{self.place} holds work of another plan, which differs in {', '.join(differs)};"
            raise InvalidInput("work-plan", f"{message} give the command it began with, or another directory to --work")


def _owner() -> bytes:
    return json.dumps({"host": socket.gethostname(), "process": os.getpid()}).encode()


def describe(value: Any) -> Any:
    """A value as JSON can hold it: the same for equal values, with a digest in place of an array."""
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: describe(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, np.ndarray):
        return [str(value.dtype), list(value.shape), hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()]
    if isinstance(value, Mapping):
        return {str(key): describe(value[key]) for key in sorted(value, key=str)}
    if isinstance(value, list | tuple):
        return [describe(one) for one in value]
    if value is None or isinstance(value, bool | int | str):
        return value
    return repr(float(value))
