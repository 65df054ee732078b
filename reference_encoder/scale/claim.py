"""A work directory is used by one encoding at a time: a file says by whom.

On a disk the system itself lets go of the file when its process ends, however that happens. At a URL nobody does: what
the file says of the process is looked up where that is possible, and reported where it is not.
"""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NoReturn

from reference_encoder.scale.places import local_path
from reference_encoder.scale.work import Work
from scarfmt.errors import InvalidInput

NAME = "in-use.json"
_PROCESSES = Path("/proc")


@contextmanager
def claimed(work: Work) -> Iterator[None]:
    """Have a work directory for oneself. What an encoding left that ended without a word is taken over.

    Raises:
        InvalidInput: ``work-in-use``: another process works there.
    """
    path = local_path(work.path(NAME))
    with _on_disk(work, path) if path is not None else _at_url(work):
        yield


@contextmanager
def _on_disk(work: Work, path: Path) -> Iterator[None]:
    try:
        import fcntl
    except ImportError:  # not a POSIX system
        with _at_url(work):
            yield
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    # Opened to append: it is not emptied before it is held.
    with path.open("a+b") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            _refuse(work, _said(path.read_bytes()), "wait for it, or end it")
        file.truncate(0)
        file.write(_own())
        file.flush()
        try:
            yield
        finally:
            # It stays, empty: who removes a file that others may hold makes two of it.
            file.truncate(0)


@contextmanager
def _at_url(work: Work) -> Iterator[None]:
    if NAME in work.names():
        said = _said(work.read(NAME))
        if _alive(said) is not False:
            _refuse(work, said, f"wait for it; if it has ended, remove {work.path(NAME)}")
    with work.write(NAME) as file:
        file.write(_own())
    try:
        yield
    finally:
        with suppress(FileNotFoundError):
            work.remove(NAME)


def _refuse(work: Work, said: dict[str, Any], advice: str) -> NoReturn:
    who = f"process {said.get('process', '?')} of {said.get('host', '?')}, since {said.get('since', '?')}"
    raise InvalidInput("work-in-use", f"{work.place} is in use by {who}: {advice}, or give another directory to --work")


def _own() -> bytes:
    """The claim of this process, as the file holds it."""
    me = os.getpid()
    since = datetime.now(UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
    said = {"host": socket.gethostname(), "process": me, "began": _began(me), "since": since}
    return json.dumps(said).encode()


def _said(data: bytes) -> dict[str, Any]:
    """The claim in a file; nothing where it is cut short."""
    with suppress(ValueError):
        said = json.loads(data)
        if isinstance(said, dict):
            return said
    return {}


def _began(process: int) -> str | None:
    """When a process began, in ticks since its system did, with the name of that; None where it cannot be known.

    Numbers of processes are given again; with their beginning they are not.
    """
    try:
        stat = (_PROCESSES / str(process) / "stat").read_text()
        boot = (_PROCESSES / "sys" / "kernel" / "random" / "boot_id").read_text().strip()
    except OSError:
        return None
    return f"{boot} {stat.rpartition(')')[2].split()[19]}"


def _alive(said: dict[str, Any]) -> bool | None:
    """Ask if the process that a file names still runs; None where it cannot be known from here."""
    if said.get("host") != socket.gethostname() or said.get("began") is None or not _PROCESSES.is_dir():
        return None
    return bool(_began(int(said["process"])) == said["began"])
