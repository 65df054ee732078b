"""Every error scarfmt raises on purpose, sorted by what the reader of the message can do about it.

::

    ScarError                     anything below; carries `refusal`, `offset`, `field`
    ├── Unsupported               the file may be fine: a newer or fuller reader is needed
    ├── Malformed                 the file breaks a rule: get an undamaged copy, or fix its writer
    │   └── Truncated             the file ends early: what arrived is readable with `allow_truncated`
    ├── LimitExceeded             the file asks for more than this reader allows: raise the limit, or refuse
    └── InvalidInput              the input of an encoder or command is unusable: fix the input (also a ValueError)

A refusal id (SPEC §12) is stable: programs may match on it. The message is for people and may change.
"""

from __future__ import annotations

from typing import Any


class ScarError(Exception):
    """Base of all deliberate errors.

    Args:
        refusal: stable refusal id of SPEC §12, e.g. ``"crc-mismatch"``.
        message: what is wrong and what to do about it.
        offset: absolute byte offset in the file where the fault was seen, if known.
        field: dotted name of the field or structure, if known.
    """

    def __init__(self, refusal: str, message: str, *, offset: int | None = None, field: str | None = None):
        self.refusal = refusal
        self.message = message
        self.offset = offset
        self.field = field
        super().__init__(str(self))

    def __str__(self) -> str:
        where = [] if self.field is None else [self.field]
        if self.offset is not None:
            where.append(f"byte {self.offset}")
        place = f" ({', '.join(where)})" if where else ""
        return f"{self.refusal}: {self.message}{place}"

    def __reduce__(self) -> tuple[Any, ...]:
        # BaseException would call the class with the printed text alone: no error would survive a worker process.
        return _restored, (type(self), self.refusal, self.message, self.offset, self.field)


def _restored(kind: type[ScarError], refusal: str, message: str, offset: int | None, field: str | None) -> ScarError:
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


class InputWarning(UserWarning):
    """An input is used, but part of it was ignored, or it looks like a mistake. The command line prints it."""


def missing_package(package: str, extra: str) -> InvalidInput:
    """The error for work that needs a package of an extra: ``input-dependency``.

    Args:
        package: name that cannot be imported.
        extra: the extra of pyproject.toml that brings it.
    """
    # pip takes the extra from the scarfmt that is installed: the command works though no index has the name.
    message = f"this needs the package {package}: pip install 'scarfmt[{extra}]'"
    return InvalidInput("input-dependency", message)
