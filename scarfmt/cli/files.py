"""File names on the command line: paths, pipes, URLs, and `-` for standard input or output."""

from __future__ import annotations

import codecs
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import click

if TYPE_CHECKING:
    from scarfmt.container.source import ByteSource

STANDARD = "-"

_TIMEOUT = "scarfmt.timeout"
_SURROGATE = re.compile("[\ud800-\udfff]")


def _keep_timeout(ctx: click.Context, _parameter: click.Parameter, value: float | None) -> None:
    if value is not None:
        ctx.meta[_TIMEOUT] = value


timeout_option = click.option(
    "--timeout",
    type=click.FloatRange(0.01, 86400),
    metavar="SECONDS",
    expose_value=False,
    callback=_keep_timeout,
    help="Maximum seconds for a request to a URL, plus one second for every 4 KiB requested [default: 60].",
)
"""Of commands that read URLs; :func:`open_input` obeys it."""


def read_origin(name: str, limit: int | None = None) -> str | bytes:
    """The bytes of standard input if `name` is `-`, the bytes of a pipe, else the path or URL as it is.

    Args:
        limit: bytes accepted of a stream; default what a .scar file may have.

    Raises:
        InvalidInput: ``input-stream`` when standard input is closed; ``input-source`` when a pipe cannot be opened.
        LimitExceeded: ``input-limit`` when there are more than `limit` bytes.
    """
    if name != STANDARD and ("://" in name or not _is_stream(Path(name))):
        from scarfmt.atomic import note_read

        note_read(name)
        return name
    from scarfmt.container.source import MAX_STREAM_BYTES, read_bounded
    from scarfmt.errors import InvalidInput

    limit = MAX_STREAM_BYTES if limit is None else limit
    if name == STANDARD:
        if sys.stdin is None:
            raise InvalidInput("input-stream", "standard input is closed: give a file name, or connect it")
        return read_bounded(sys.stdin.buffer, "standard input", limit)
    try:
        with Path(name).open("rb") as stream:
            return read_bounded(stream, name, limit)
    except OSError as error:
        raise InvalidInput("input-source", f"cannot open {name}: {error.strerror}") from error


def _is_stream(path: Path) -> bool:
    """Whether a path names a pipe, a socket or a character device: such a thing can be read once, from its start."""
    try:
        return path.is_fifo() or path.is_char_device() or path.is_socket()
    except (OSError, ValueError):
        return False


def open_input(name: str | bytes, *, head_bytes: int | None = None) -> ByteSource:
    """The .scar file of that name, to be used as a context manager.

    Args:
        name: a path, a URL, or `-`; or the bytes of a file.
        head_bytes: of a URL, size of the first request; default what suits decoding.

    Raises:
        InvalidInput: ``input-source`` when it cannot be opened; ``input-stream`` when standard input is closed;
            ``input-dependency`` when a URL needs a missing package.
        LimitExceeded: ``input-limit`` when a pipe does not end.
    """
    from scarfmt.container.source import HEAD_BYTES, TIMEOUT_SECONDS, open_source

    ctx = click.get_current_context(silent=True)
    timeout = ctx.meta.get(_TIMEOUT, TIMEOUT_SECONDS) if ctx is not None else TIMEOUT_SECONDS
    origin = read_origin(name) if isinstance(name, str) else name
    return open_source(origin, timeout=timeout, head_bytes=head_bytes or HEAD_BYTES)


@contextmanager
def open_output(name: str, force: bool) -> Iterator[BinaryIO]:
    """A binary file that appears under its name only when complete; refused at once where the name is taken.

    Raises:
        InvalidInput: ``output-exists``, ``output-path``, or ``output-stream`` when standard output is closed.
    """
    from scarfmt.atomic import atomic_write

    if name == STANDARD:
        check_stdout()
        stream = sys.stdout.buffer
        if stream.isatty():
            raise click.UsageError("refusing to write binary data to a terminal: redirect it, or give a file name")
        yield stream
        stream.flush()
        return
    with atomic_write(name, force=force) as file:
        yield file


def check_output(name: str, force: bool) -> None:
    """Refuse an output name before long work, by the rules of :func:`open_output`. No file is left behind.

    Raises:
        InvalidInput: ``output-exists``, ``output-path``, or ``output-stream`` when standard output is closed.
    """
    with suppress(EOFError), open_output(name, force):
        raise EOFError  # what is written up to an error leaves no file


def check_stdout() -> None:
    """Refuse to work if standard output is closed: the result would be lost.

    Raises:
        InvalidInput: ``output-stream``.
    """
    if sys.stdout is None:
        from scarfmt.errors import InvalidInput

        raise InvalidInput("output-stream", "standard output is closed: give a file name, or connect it")


def print_json(value: Any) -> None:
    """A JSON document on stdout. Infinities, which JSON lacks, become null.

    Characters that standard output cannot carry are written as JSON escapes: lone surrogates, for which the bytes of
    file names stand that are not UTF-8, and on a stream that is not UTF-8 all but ASCII.

    Raises:
        InvalidInput: ``output-stream`` when standard output is closed.
    """
    import json

    check_stdout()
    ascii_only = codecs.lookup(sys.stdout.encoding or "ascii").name != "utf-8"
    text = json.dumps(_finite(value), indent=2, ensure_ascii=ascii_only, allow_nan=False)
    click.echo(_SURROGATE.sub(lambda found: f"\\u{ord(found[0]):04x}", text))


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float) and not abs(value) < float("inf"):
        return None
    return value
