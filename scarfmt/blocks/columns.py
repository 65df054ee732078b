"""Many equal records of varints read at once, by their declaration: a column a field.

Reading record by record takes microseconds a field. Where all fields are LEB128 integers, the payload is a list of
numbers, found at once, and a record is so many of them: only its array lengths have to be read one by one. Nothing
is refused here: what is not sound is left to :func:`scarfmt.blocks.declare.read`, which knows the first fault.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from scarfmt.arrays import I64
from scarfmt.blocks.declare import Count, Record, Rule, SignedVarint, Varint, unnamed
from scarfmt.container.bytefields import varints

# Fifty times as much memory is in use meanwhile; tables of real scenes take a fiftieth of this.
_AT_ONCE = 1 << 20
_BITS = 33


@dataclass(frozen=True)
class Columns:
    """Records, field by field.

    Attributes:
        scalars: (records,) int64, by name.
        arrays: the items of all records, one after the other, by name.
        lengths: (records,) items of each array in a record, by name.
    """

    scalars: Mapping[str, I64]
    arrays: Mapping[str, I64]
    lengths: Mapping[str, I64]


class _Probe(dict[str, int]):
    """Gives every name the same value, and remembers the last."""

    def __init__(self, value: int) -> None:
        super().__init__()
        self.value, self.asked = value, ""

    def __missing__(self, name: str) -> int:
        self.asked = name
        return self.value


class ColumnReader:
    """Reads payloads that are a count, then so many records of scalars and, after those, arrays.

    Args:
        count: the declaration of the count.
        record: of a record; array lengths are one of its scalars, times and plus a constant.
    """

    def __init__(self, count: Count, record: Record) -> None:
        self._most = count.limit
        members = [(member.name, unnamed(member)) for member in record.members]
        fields = [(name, element) for name, element in members if not isinstance(element, Rule)]
        self._scalars = [field for field in fields if isinstance(field[1], Varint | SignedVarint | Count)]
        self._arrays = [(name, element, *_line(element.count)) for name, element in fields[len(self._scalars) :]]
        self._sized = [name for name, _ in self._scalars].index(_length_name(self._arrays[0][1].count))

    def read(self, payload: bytes) -> Columns | None:
        """The records of a payload, None if it is too long for this, or not sound."""
        numbers = varints(payload, bits=_BITS) if len(payload) <= _AT_ONCE else None
        if numbers is None or numbers[0] > self._most:
            return None
        places = self._places(numbers.tolist())
        if places is None:
            return None
        scalars = {name: numbers[places + index] for index, (name, _) in enumerate(self._scalars)}
        sizes = scalars[self._scalars[self._sized][0]]
        arrays, lengths, starts = {}, {}, places + len(self._scalars)
        for name, element, constant, factor in self._arrays:
            lengths[name] = constant + factor * sizes
            begins = np.cumsum(lengths[name]) - lengths[name]
            arrays[name] = numbers[np.repeat(starts - begins, lengths[name]) + np.arange(int(lengths[name].sum()))]
            starts = starts + lengths[name]
            if (arrays[name] >> element.bits).any():
                return None
        if not all(_in_range(element, scalars[name]) for name, element in self._scalars):
            return None
        signed = {name: _unfolded(scalars[name]) for name, at in self._scalars if isinstance(at, SignedVarint)}
        return Columns({**scalars, **signed}, arrays, lengths)

    def _places(self, numbers: list[int]) -> I64 | None:
        """Offset of each record, (records,); None if the records do not fit."""
        constant = len(self._scalars) + sum(row[2] for row in self._arrays)
        factor = sum(row[3] for row in self._arrays)
        least = max((-row[2] // row[3] for row in self._arrays if row[3]), default=0)
        sized, total, places, at = self._sized, len(numbers), [], 1
        # One by one: where a record begins, only the one before tells.
        for _ in range(numbers[0]):
            if at + sized >= total or numbers[at + sized] < least:
                return None
            places.append(at)
            at += constant + factor * numbers[at + sized]
        return np.array(places, np.int64) if at == total else None


def _line(expression: Any) -> tuple[int, int]:
    """Constant and factor of an expression of one name."""
    constant, one = expression(_Probe(0)), expression(_Probe(1))
    return constant, one - constant


def _length_name(expression: Any) -> str:
    probe = _Probe(0)
    expression(probe)
    return probe.asked


def _in_range(element: Any, values: I64) -> bool:
    most = element.limit if isinstance(element, Count) else (1 << element.bits) - 1
    return bool((values <= most).all())


def _unfolded(values: I64) -> I64:
    return np.asarray((values >> 1) ^ -(values & 1))
