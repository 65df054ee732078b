"""Every error scarfmt raises on purpose, sorted by what the reader of the message can do about it.

::

    ScarError                     anything below; carries `refusal`, `offset`, `field`
    ├── Unsupported               the file may be fine: a newer or fuller reader is needed
    ├── Malformed                 the file breaks a rule: get an undamaged copy, or fix its writer
    │   └── Truncated             the file ends early: what arrived is readable with `allow_truncated`
    ├── LimitExceeded             the file asks for more than this reader allows: raise the limit, or refuse
    └── InvalidInput              the input of an encoder or command is unusable: fix the input (also a ValueError)
        ├── MissingFile           also a FileNotFoundError
        ├── DeniedFile            also a PermissionError
        └── FileTaken             also a FileExistsError

A refusal id (SPEC §12) is stable: programs may match on it. The message is for people and may change.
"""

from __future__ import annotations

from typing import Any

MAX_MESSAGE, MAX_FIELD = 1000, 200


def printable(text: str, most: int = MAX_MESSAGE) -> str:
    """Text from a file as a message or a terminal may have it.

    What does not print (control characters, lone surrogates) is escaped. What is beyond `most` characters is cut.
    """
    cut = text if len(text) <= most else f"{text[: most - 3]}..."
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in cut)


class ScarError(Exception):
    """Base of all deliberate errors.

    Args:
        refusal: stable refusal id of SPEC §12, e.g. ``"crc-mismatch"``.
        message: what is wrong and what to do about it; made :func:`printable`.
        offset: absolute byte offset in the file where the fault was seen, if known.
        field: dotted name of the field or structure, if known.
    """

    def __init__(self, refusal: str, message: str, *, offset: int | None = None, field: str | None = None):
        self.refusal = refusal
        self.message = printable(message)
        self.offset = offset
        self.field = None if field is None else printable(field, MAX_FIELD)
        super().__init__(str(self))

    def __str__(self) -> str:
        where = [] if self.field is None else [self.field]
        if self.offset is not None:
            where.append(f"byte {self.offset}")
        place = f" ({', '.join(where)})" if where else ""
        return f"{self.refusal}: {self.message}{place}"

    def __reduce__(self) -> tuple[Any, ...]:
        # BaseException would call the class with the printed text alone: no error would survive a worker process.
        return _restore, (type(self), self.refusal, self.message, self.offset, self.field)


def _restore(kind: type[ScarError], refusal: str, message: str, offset: int | None, field: str | None) -> ScarError:
    return kind(refusal, message, offset=offset, field=field)


class Unsupported(ScarError):
    """A newer or fuller reader is needed; the file itself may be valid."""


class Malformed(ScarError):
    """The file breaks a rule of SPEC.md."""


class Truncated(Malformed):
    """The file ends before the bytes its header declares."""


class LimitExceeded(ScarError):
    """The file is larger, in some declared number, than this reader allows."""


class InvalidInput(ScarError, ValueError):
    """The input of an encoder or a command cannot be used."""


class MissingFile(InvalidInput, FileNotFoundError):
    """A file to be read is not there."""


class DeniedFile(InvalidInput, PermissionError):
    """A file may not be read or written."""


class FileTaken(InvalidInput, FileExistsError):
    """A file to be written exists."""


def file_error(refusal: str, message: str, cause: BaseException, offset: int | None = None) -> InvalidInput:
    """The error for a file that cannot be used, of the kind of its cause."""
    for kind, base in ((MissingFile, FileNotFoundError), (DeniedFile, PermissionError)):
        if isinstance(cause, base):
            return kind(refusal, message, offset=offset)
    return InvalidInput(refusal, message, offset=offset)


class InputWarning(UserWarning):
    """An input is used, but part of it was ignored, or it looks like a mistake. The command line prints it."""


class LossWarning(InputWarning):
    """Part of a scene is left out that nobody asked to leave out. The command line prints it even if it is quiet."""


def missing_package(package: str, extra: str) -> InvalidInput:
    """The error for work that needs a package of an extra: ``input-dependency``.

    Args:
        package: name that cannot be imported.
        extra: the extra of pyproject.toml that brings it.
    """
    # pip takes the extra from the scarfmt that is installed: the command works though no index has the name.
    message = f"this needs the package {package}: pip install 'scarfmt[{extra}]'"
    return InvalidInput("input-dependency", message)


def plural(count: int, noun: str) -> str:
    """A count with its noun: ``1 layer``, ``2,000 layers``."""
    return f"{count:,} {noun}" if count == 1 else f"{count:,} {noun}s"
