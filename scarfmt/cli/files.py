"""File names on the command line: paths, URLs, and `-` for standard input or output."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import click

if TYPE_CHECKING:
    from scarfmt.container.source import ByteSource

STANDARD = "-"


def read_origin(name: str) -> str | bytes:
    """What `name` stands for: the bytes of standard input for `-`, else the path or URL itself."""
    return sys.stdin.buffer.read() if name == STANDARD else name


def open_input(name: str) -> ByteSource:
    """The .scar file of that name, to be used as a context manager.

    Raises:
        InvalidInput: ``input-source`` when it cannot be opened.
    """
    from scarfmt.container.source import open_source

    return open_source(read_origin(name))


@contextmanager
def open_output(name: str, force: bool) -> Iterator[BinaryIO]:
    """A binary file that appears under its name only when complete; refused at once where the name is taken.

    Raises:
        InvalidInput: ``output-exists`` or ``output-path``.
    """
    from scarfmt.atomic import atomic_write

    if name == STANDARD:
        stream = sys.stdout.buffer
        if stream.isatty():
            raise click.UsageError("refusing to write binary data to a terminal: redirect it, or give a file name")
        yield stream
        stream.flush()
        return
    with atomic_write(name, force=force) as file:
        yield file


def check_extension(name: str, known: tuple[str, ...]) -> str:
    """The lower-case extension of an output name.

    Raises:
        click.UsageError: it is not one of `known`.
    """
    extension = Path(name).suffix.lower()
    if extension not in known:
        raise click.UsageError(f"the output must end in {' or '.join(known)}, not {extension or 'nothing'}")
    return extension


def print_json(value: Any) -> None:
    """A JSON document on stdout. Infinities, which JSON lacks, become null."""
    import json

    click.echo(json.dumps(_finite(value), indent=2, ensure_ascii=False, allow_nan=False))


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float) and not abs(value) < float("inf"):
        return None
    return value
