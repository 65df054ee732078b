"""Declaring the layout of a payload: records of named fields, arrays, repetitions and the rules between them.

A declaration is data, written with the `construct` library's names (``"name" / element``), descriptions
(``* "..."``, normative) and expressions (``this.rows * this.columns``). From one declaration come reading, packing,
the listing that SPEC prints (:mod:`scarfmt.blocks.listing`) and `scarfmt dump`.

Reading is not construct's own: a payload is not trusted, so counts have limits, arrays are checked against the bytes
left before they are made, and rules are applied at the place in which they are declared (SPEC §12.2).
"""

from __future__ import annotations

import struct
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from construct import Construct, Float64l, FormatField, Int8ul, Int32ul, Renamed

from scarfmt.container.bytefields import ByteReader, signed_varint, unsigned_varint
from scarfmt.container.registries import Stream
from scarfmt.container.schema import scalar_type
from scarfmt.entropy.rice import pack_rice, pack_shifted, unpack_rice, unpack_shifted
from scarfmt.errors import ScarError


class Scope(dict[str, Any]):
    """Values by name: those of a record, then those of what is around it."""

    def __init__(self, around: Mapping[str, Any]) -> None:
        super().__init__()
        self._around = around

    def __missing__(self, name: str) -> Any:
        return self._around[name]


Values = Mapping[str, Any]


class Trace(Protocol):
    """Hears which bytes are what, as they are read."""

    def enter(self, name: str | int, at: int) -> None:
        """A field, or the item of this number of a repetition, begins at byte `at` of the payload."""

    def leave(self, value: Any, at: int) -> None:
        """The field that began last ends before byte `at` and has this value."""

    def part(self, name: str, start: int, past: int, value: Any) -> None:
        """Bytes `start` to `past` of the payload are a part of the field that has begun."""


class Cursor(ByteReader):
    """A reader of one payload that may be watched."""

    def __init__(self, data: bytes, field: str, trace: Trace | None = None) -> None:
        super().__init__(data, field)
        self.trace = trace


class Element(Construct, ABC):  # type: ignore[misc]  # construct has no types
    """A part of a payload."""

    spelled = ""
    """Type of the field, as SPEC prints it."""

    @abstractmethod
    def take(self, reader: Cursor, scope: Scope) -> Any:
        """Read it; `scope` has what was read before."""

    @abstractmethod
    def put(self, value: Any, scope: Values) -> bytes:
        """The bytes of a value."""

    def shown(self, value: Any) -> Any:
        """A value in the form of reports."""
        return value


def evaluated(expression: Any, scope: Values) -> Any:
    """The value of an expression of construct, or of a constant."""
    return expression(scope) if callable(expression) else expression


class Scalar(Element):
    """An integer or float of a fixed size, little-endian."""

    def __init__(self, field: FormatField, shown: Callable[[Any], Any] | None = None) -> None:
        super().__init__()
        self.code, self._shown = field.fmtstr[1:], shown
        self.spelled, self.dtype = scalar_type(field)
        self._struct = struct.Struct(field.fmtstr)

    def take(self, reader: Cursor, scope: Scope) -> Any:
        return self._struct.unpack(reader.take(self._struct.size))[0]

    def put(self, value: Any, scope: Values) -> bytes:
        return self._struct.pack(value)

    def shown(self, value: Any) -> Any:
        return value if self._shown is None else self._shown(value)


def stream_name(number: int) -> str:
    """The name of a stream kind in reports."""
    return f"{number} {Stream(number).name}" if number in set(Stream) else str(number)


U8, U32, F64 = Scalar(Int8ul), Scalar(Int32ul), Scalar(Float64l)
STREAM = Scalar(Int8ul, stream_name)
"""A stream kind, u8."""


class Varint(Element):
    """An unsigned LEB128 integer below 2^bits (SPEC §5.7)."""

    def __init__(self, bits: int, shown: Callable[[int], Any] | None = None) -> None:
        super().__init__()
        self.bits, self.spelled, self._shown = bits, f"varint({bits})", shown

    def take(self, reader: Cursor, scope: Scope) -> int:
        return reader.unsigned(self.bits)

    def put(self, value: int, scope: Values) -> bytes:
        return unsigned_varint(value)

    def shown(self, value: int) -> Any:
        return value if self._shown is None else self._shown(value)


class SignedVarint(Element):
    """A zigzag LEB128 integer whose mapped value is below 2^bits (SPEC §5.7)."""

    def __init__(self, bits: int) -> None:
        super().__init__()
        self.bits, self.spelled = bits, f"svarint({bits})"

    def take(self, reader: Cursor, scope: Scope) -> int:
        return reader.signed(self.bits)

    def put(self, value: int, scope: Values) -> bytes:
        return signed_varint(value)


class Count(Element):
    """A LEB128 integer that counts things, of which there may be `limit` at most (SPEC §5.7)."""

    def __init__(self, limit: int) -> None:
        super().__init__()
        self.limit, self.spelled = limit, f"count({limit})"

    def take(self, reader: Cursor, scope: Scope) -> int:
        return reader.count(self.limit)

    def put(self, value: int, scope: Values) -> bytes:
        return unsigned_varint(value)


class Varints(Element):
    """(count,) int64: LEB128 integers below 2^bits, one after the other.

    Args:
        bits, count: of each, and how many.
        refused: what is wrong with the first so many of them, None if nothing.
    """

    def __init__(
        self, bits: int, count: Any, refused: Callable[[Any, Scope], ScarError | None] = lambda values, scope: None
    ) -> None:
        super().__init__()
        self.bits, self.count, self._refused = bits, count, refused

    @property
    def item(self) -> str:
        """The type of one."""
        return f"varint({self.bits})"

    def take(self, reader: Cursor, scope: Scope) -> Any:
        count, start = evaluated(self.count, scope), reader.position
        try:
            values = reader.unsigned_array(self.bits, count)
        except ScarError:
            # What is wrong with an earlier one comes first (SPEC §12.2).
            self._check(self._sound(reader, start, count), scope)
            raise
        self._check(values, scope)
        return values

    def _sound(self, reader: Cursor, start: int, count: int) -> Any:
        """The items before the first that cannot be read."""
        reader.rewind(start)
        values: list[int] = []
        try:
            while len(values) < count:
                values.append(reader.unsigned(self.bits))
        except ScarError:
            pass
        return np.array(values, np.int64)

    def _check(self, values: Any, scope: Scope) -> None:
        error = self._refused(values, scope)
        if error is not None:
            raise error

    def put(self, value: Any, scope: Values) -> bytes:
        return b"".join(map(unsigned_varint, value.tolist()))


class Numbers(Element):
    """(count,) numbers of a fixed size, little-endian.

    Args:
        dtypes: their numpy type without byte order, by the number of bytes that `width` is.
        count: how many.
        width: an expression, or a constant where all files have the same.
    """

    def __init__(self, dtypes: Mapping[int, str], count: Any, width: Any) -> None:
        super().__init__()
        self.dtypes, self.count, self.width = dtypes, count, width

    def take(self, reader: Cursor, scope: Scope) -> Any:
        return reader.array(f"<{self.dtypes[evaluated(self.width, scope)]}", evaluated(self.count, scope))

    def put(self, value: Any, scope: Values) -> bytes:
        if isinstance(value, bytes):
            return value
        return bytes(value.astype(f"<{self.dtypes[evaluated(self.width, scope)]}").tobytes())


class Bits(Element):
    """(count,) int64, Rice-coded (SPEC §5.9); `shifted` where numbers may share zero bits at their end."""

    def __init__(self, count: Any, shifted: bool = False) -> None:
        super().__init__()
        self.count, self.shifted = count, shifted

    def take(self, reader: Cursor, scope: Scope) -> Any:
        count, start = evaluated(self.count, scope), reader.position
        values = unpack_shifted(reader, count) if self.shifted else unpack_rice(reader, count)
        if reader.trace is not None:
            self._report(reader, reader.trace, (start, reader.position), values)
        return values

    def _report(self, reader: Cursor, trace: Trace, span: tuple[int, int], values: Any) -> None:
        start, past = span
        if self.shifted:
            trace.part("shift", start, start + 1, reader.byte(start))
            start += 1
        parameter = reader.byte(start)
        low = past - (len(values) * parameter + 7) // 8
        trace.part("k", start, start + 1, parameter)
        trace.part("quotients", start + 1, low, values)
        trace.part("low", low, past, f"{len(values)} x {parameter} bits")

    def put(self, value: Any, scope: Values) -> bytes:
        return pack_shifted(value) if self.shifted else pack_rice(value)


class Blob(Element):
    """A number of bytes that another part reads."""

    def __init__(self, count: Any) -> None:
        super().__init__()
        self.count = count

    def take(self, reader: Cursor, scope: Scope) -> bytes:
        return reader.take(evaluated(self.count, scope))

    def put(self, value: bytes, scope: Values) -> bytes:
        return value


class Check(NamedTuple):
    """The sentence that SPEC.md prints where a rule is applied.

    Attributes:
        number: of the rule.
        holds: what of it must hold here.
        otherwise: refusal ids, where not.
    """

    number: str
    holds: str
    otherwise: str


class Rule(Element):
    """A rule that is applied when all before it is read.

    Args:
        check: as SPEC.md prints it.
        holds: whether it is kept.
        refusal: the error, where not.
    """

    def __init__(self, check: Check, holds: Callable[[Scope], bool], refusal: Callable[[Scope], ScarError]) -> None:
        super().__init__()
        self.check, self._holds, self._refusal = check, holds, refusal

    def take(self, reader: Cursor, scope: Scope) -> None:
        if not self._holds(scope):
            raise self._refusal(scope)

    def put(self, value: None, scope: Values) -> bytes:
        return b""


class Derived(Element):
    """A value made of what was read; it takes no bytes.

    Args:
        made: makes it, and may refuse.
        text: how, as SPEC prints it; empty for what is no matter of the format.
        checks: what is checked.
    """

    def __init__(self, made: Callable[[Scope], Any], text: str = "", checks: Sequence[Check] = ()) -> None:
        super().__init__()
        self._made, self.text, self.checks = made, text, checks

    def take(self, reader: Cursor, scope: Scope) -> Any:
        return self._made(scope)

    def put(self, value: Any, scope: Values) -> bytes:
        return b""


class Record(Element):
    """Fields one after the other; read as a :class:`Scope` of their values, packed from any mapping of them."""

    def __init__(self, *members: Any) -> None:
        super().__init__()
        self.members = members
        self._steps = [(member.name, unnamed(member)) for member in members]
        self._runs = _fused(self._steps)

    def take(self, reader: Cursor, scope: Scope) -> Scope:
        values = Scope(scope)
        self.fill(reader, values)
        return values

    def fill(self, reader: Cursor, values: Scope) -> None:
        """Read the fields into `values`."""
        if reader.trace is not None:
            self._fill_watched(reader, reader.trace, values)
            return
        for name, element in self._runs:
            if isinstance(name, tuple):
                values.update(zip(name, element.unpack(reader.take(element.size)), strict=True))
            elif name is None:
                element.take(reader, values)
            else:
                values[name] = element.take(reader, values)

    def _fill_watched(self, reader: Cursor, trace: Trace, values: Scope) -> None:
        for name, element in self._steps:
            if name is None:
                element.take(reader, values)
                continue
            trace.enter(name, reader.position)
            values[name] = element.take(reader, values)
            trace.leave(element.shown(values[name]), reader.position)

    def put(self, value: Values, scope: Values) -> bytes:
        values = Scope(scope)
        values.update(value)
        return self.put_members(values)

    def put_members(self, values: Values) -> bytes:
        """The bytes of the fields, whose values are in scope."""
        return b"".join(
            element.put(None if name is None or isinstance(element, Derived) else values[name], values)
            for name, element in self._steps
        )


def unnamed(member: Any) -> Any:
    """The element of a member, without its name and description."""
    while isinstance(member, Renamed):
        member = member.subcon
    return member


def _fused(steps: Sequence[tuple[str | None, Any]]) -> list[tuple[Any, Any]]:
    """The steps, those of neighbouring scalars in one: they are read at once."""
    out: list[tuple[Any, Any]] = []
    names: list[str | None] = []
    codes = ""
    for name, element in [*steps, (None, None)]:
        if isinstance(element, Scalar):
            names.append(name)
            codes += element.code
            continue
        if names:
            out.append((tuple(names), struct.Struct("<" + codes)))
            names, codes = [], ""
        if element is not None:
            out.append((name, element))
    return out


class When(Element):
    """Members of the record around it that are there only under a condition."""

    def __init__(self, condition: Any, *members: Any) -> None:
        super().__init__()
        self.condition, self.record = condition, Record(*members)

    def take(self, reader: Cursor, scope: Scope) -> None:
        if evaluated(self.condition, scope):
            self.record.fill(reader, scope)

    def put(self, value: None, scope: Values) -> bytes:
        return self.record.put_members(scope) if evaluated(self.condition, scope) else b""


class Repeat(Element):
    """A list of `count` items; an item sees its `index`, from 0, and the list of those `earlier`."""

    def __init__(self, count: Any, item: Element) -> None:
        super().__init__()
        self.count, self.item = count, item

    def take(self, reader: Cursor, scope: Scope) -> list[Any]:
        out: list[Any] = []
        around = Scope(scope)
        around["earlier"] = out
        for index in range(evaluated(self.count, scope)):
            around["index"] = index
            if reader.trace is not None:
                reader.trace.enter(index, reader.position)
            value = self.item.take(reader, around)
            if reader.trace is not None:
                reader.trace.leave(self.item.shown(value), reader.position)
            out.append(value)
        return out

    def put(self, value: Sequence[Any], scope: Values) -> bytes:
        around = Scope(scope)
        out = []
        for index, item in enumerate(value):
            around["index"] = index
            out.append(self.item.put(item, around))
        return b"".join(out)


class Use(Element):
    """A record declared elsewhere, under its name in SPEC and with its parameters."""

    def __init__(self, name: str, record: Element, **parameters: Any) -> None:
        super().__init__()
        self.title, self.record, self.parameters = name, record, parameters

    def take(self, reader: Cursor, scope: Scope) -> Any:
        around = Scope(scope)
        around.update({name: evaluated(given, scope) for name, given in self.parameters.items()})
        return self.record.take(reader, around)

    def put(self, value: Any, scope: Values) -> bytes:
        return self.record.put(value, scope)


def read(record: Record, payload: bytes, field: str, trace: Trace | None = None, **parameters: Any) -> Scope:
    """The fields of a payload, which must be exactly `record`.

    Args:
        record: its declaration.
        payload: its bytes.
        field: what errors call it.
        trace: hears where every field lies.
        parameters: what the declaration needs to know beforehand.

    Raises:
        Malformed: ``payload-short``, ``payload-long``, ``bad-varint``, ``bad-rice``, or what a rule refuses.
        LimitExceeded: ``count-limit``.
    """
    reader = Cursor(payload, field, trace)
    around = Scope({})
    around.update(parameters)
    values = record.take(reader, around)
    reader.finish()
    return values


def build(record: Record, values: Values, **parameters: Any) -> bytes:
    """The payload of `values`: the inverse of :func:`read`. Counts must be among them."""
    return record.put(values, parameters)
