"""Some places of a value or of bytes changed, and all else as it was."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import is_dataclass, replace
from typing import Any

import numpy as np

from conformance.writer.numbers import Number

Changes = Mapping[str, Any]
"""By path, such as ``gru.0.start.-1``, a value or a function of that which is there. The empty path is the whole."""


def edit(value: Any, changes: Changes) -> Any:
    """A copy with other fields: of dataclasses and rows by name, of lists, tuples and arrays by number."""
    for path, new in changes.items():
        value = _put(value, path.split(".") if path else [], new)
    return value


def _put(value: Any, path: list[str], new: Any) -> Any:
    if not path:
        return new(value) if callable(new) else new
    step, *rest = path
    if is_dataclass(value) and not isinstance(value, type):
        return replace(value, **{step: _put(getattr(value, step), rest, new)})
    if isinstance(value, dict):
        return {**value, step: _put(value[step], rest, new)}
    # Numbers too large for the type of an array are among the faults.
    items: Any = value.astype(np.int64) if isinstance(value, np.ndarray) else list(value)
    items[int(step)] = _put(items[int(step)], rest, new)
    return tuple(items) if isinstance(value, tuple) else items


def plus(more: int) -> Callable[[int], int]:
    """A change of a number by so much."""
    return lambda number: number + more


more = plus(1)


def further(number: int) -> int:
    """The next integer further from 0."""
    return number + (1 if number > 0 else -1)


def renumber(*changes: tuple[str | None, int]) -> Callable[[list[Number]], list[Number]]:
    """A change of numbers: others for these fields, each for the first after the one before."""

    def put(numbers: list[Number]) -> list[Number]:
        left = list(changes)
        out = [(field, left.pop(0)[1] if left and left[0][0] == field[0] else number) for field, number in numbers]
        assert not left
        return out

    return put


def splice(at: int, new: bytes, length: int = 1) -> Callable[[bytes], bytes]:
    """A change of bytes: `new` in place of so many at an offset, which may count from the end."""
    return lambda data: data[:at] + new + data[len(data[:at]) + length :]


def replace_bytes(new: bytes) -> Callable[[bytes], bytes]:
    """A change of bytes: other ones in their place."""
    return lambda _: new


def append(tail: bytes = b"\0") -> Callable[[bytes], bytes]:
    """A change of bytes: some more at their end."""
    return lambda data: data + tail


def cut(data: bytes) -> bytes:
    """All but the last byte."""
    return data[:-1]
