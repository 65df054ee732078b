"""The fields of a block's bytes as rows: what `scarfmt dump` prints of one block.

Payloads that are declared (:mod:`scarfmt.blocks.declare`) are read with a trace that notes where each field lies.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

SHOWN_NUMBERS = 8
SHOWN_ITEMS = 16


@dataclass(frozen=True)
class Row:
    """Some bytes and what they are.

    Attributes:
        offset: of the first; in the file, or among the adaptive numbers of the row before.
        length: bytes, or numbers, at least 1.
        field: what they are, from the block inwards.
        value: their value, abbreviated where there is much of it.
        section: of SPEC.md that describes them.
        content: whether `offset` and `length` count adaptive numbers.
    """

    offset: int
    length: int
    field: str
    value: Any
    section: str
    content: bool = False


def show(value: Any, full: bool) -> Any:
    """A value as rows have it: of arrays and bytes the beginning, unless `full`."""
    if isinstance(value, bytes):
        text = value if full or len(value) <= 2 * SHOWN_NUMBERS else value[: 2 * SHOWN_NUMBERS]
        return text.hex(" ") + (" …" if len(text) < len(value) else "")
    if isinstance(value, np.ndarray):
        numbers = value.ravel() if full else value.ravel()[:SHOWN_NUMBERS]
        more = f" … ({value.size} numbers)" if value.size > len(numbers) else ""
        return " ".join(map(str, numbers)) + more
    return value


@dataclass
class _Open:
    """A field that has begun."""

    path: str
    start: int
    hidden: bool = False
    split: bool = False
    held: tuple[int, int] | None = None
    items: int = 0


@dataclass
class FieldRows:
    """A :class:`scarfmt.blocks.declare.Trace` that makes rows of a payload's fields.

    Attributes:
        name: of the block.
        section: of SPEC.md.
        full: whether all items and numbers are wanted.
        rows: those found, offsets counted in the payload; without gaps.
    """

    name: str
    section: str
    full: bool
    rows: list[Row] = field(default_factory=list)
    _open: list[_Open] = field(default_factory=list)

    def enter(self, name: str | int, at: int) -> None:
        """Note that a field begins."""
        above = self._open[-1] if self._open else None
        path = self.name if above is None else above.path
        if isinstance(name, int):
            hidden = not self.full and name >= SHOWN_ITEMS
            self._open.append(_Open(f"{path}[{name}]", at, hidden or (above is not None and above.hidden)))
        else:
            self._open.append(_Open(f"{path}.{name}", at, above is not None and above.hidden))

    def leave(self, value: Any, at: int) -> None:
        """Note that it ends: a row, where none of its parts has one."""
        done = self._open.pop()
        above = self._open[-1] if self._open else None
        if done.hidden:
            if above is not None and not above.hidden:
                above.held = (done.start if above.held is None else above.held[0], at)
                above.items += 1
                above.split = True
            return
        self._flush(done)
        if at > done.start and not done.split:
            self._add(done.start, at, done.path, value)
        if above is not None:
            above.split |= at > done.start

    def close(self) -> None:
        """End all fields that have begun: reading has stopped."""
        while self._open:
            self._flush(self._open.pop())

    def _flush(self, item: _Open) -> None:
        """One row for the items of a repetition that are not shown one by one."""
        if item.held is not None and item.held[1] > item.held[0]:
            name = f"{item.path}[{SHOWN_ITEMS}..{SHOWN_ITEMS + item.items - 1}]"
            self._add(*item.held, name, f"{item.items} more")

    def _add(self, start: int, past: int, path: str, value: Any) -> None:
        self.rows.append(Row(start, past - start, path, show(value, self.full), self.section))


def rest(rows: list[Row], length: int, name: str, section: str) -> Iterator[Row]:
    """`rows`, and one for the bytes after them that nothing was made of."""
    yield from rows
    past = rows[-1].offset + rows[-1].length if rows else 0
    if past < length:
        yield Row(past, length - past, f"{name}: not read", "", section)


def move(rows: Iterable[Row], offset: int) -> Iterator[Row]:
    """Rows of a part, with offsets in what it is a part of; those of adaptive numbers stay."""
    return (row if row.content else replace(row, offset=row.offset + offset) for row in rows)
