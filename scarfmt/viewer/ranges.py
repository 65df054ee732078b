"""The `Range` header of a request (RFC 9110 §14): one range of bytes, or the whole."""

from __future__ import annotations

import re

_SINGLE = re.compile(r"bytes=(\d*)-(\d*)", re.ASCII)
_MOST_DIGITS = 18


class Unsatisfiable(Exception):
    """A range of which the file has no byte: status 416."""


def wanted(header: str | None, size: int) -> tuple[int, int] | None:
    """First byte and end of what a request wants of a file of `size` bytes; None where it is to get the whole.

    Several ranges, other units and what cannot be read are answered with the whole, as RFC 9110 §14.2 permits.

    Raises:
        Unsatisfiable: nothing of the file lies in the range.
    """
    match = _SINGLE.fullmatch(header.strip()) if header is not None else None
    if match is None or not (match[1] or match[2]) or max(len(match[1]), len(match[2])) > _MOST_DIGITS:
        return None
    if not match[1]:
        first, end = max(0, size - int(match[2])), size
    else:
        first, end = int(match[1]), min(size, int(match[2]) + 1) if match[2] else size
        if match[2] and int(match[2]) < first:
            return None
    if first >= end:
        raise Unsatisfiable
    return first, end
