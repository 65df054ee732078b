"""Declaring the layout of a payload: records of named fields, arrays, repetitions and the rules between them.

A declaration is data: ``"name" / element * "description"``, where the description is normative. Counts and conditions
are expressions in the names of earlier fields, such as ``"rows * columns"``. From one declaration come reading,
packing, the listing that SPEC prints (:mod:`scarfmt.blocks.listing`) and `scarfmt dump`.

A payload is not trusted: counts have limits, arrays are checked against the bytes left before they are made, and rules
are applied at the place in which they are declared (SPEC §12.2).
"""

from __future__ import annotations

import copy
import operator
import struct
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Self

import numpy as np

from scarfmt.container.bytefields import ByteReader, Trace, unsigned_varint
from scarfmt.container.registries import Stream
from scarfmt.entropy.numbers import NumberReader, NumberWriter, Spend
from scarfmt.errors import LimitExceeded, Malformed, ScarError

_NUMBERS = {"u1": "u8", "u4": "u32", "f4": "f32"}
"""The names that SPEC has for types of numpy."""


class Scope(dict[str, Any]):
    """Values by name: those of a record, then those of what is around it."""

    def __init__(self, around: Mapping[str, Any]) -> None:
        super().__init__()
        self._around = around

    def __missing__(self, name: str) -> Any:
        return self._around[name]


class Element(ABC):
    """A part of a payload.

    Attributes:
        name: of the field, None for what is no field.
        docs: description of the field, which is normative.
        spelled: type of the field, as SPEC prints it.
    """

    name: str | None = None
    docs = ""
    spelled = ""

    def __rtruediv__(self, name: str) -> Self:
        named = copy.copy(self)
        named.name = name
        return named

    def __mul__(self, docs: str) -> Self:
        described = copy.copy(self)
        described.docs = docs
        return described

    @abstractmethod
    def take(self, reader: ByteReader, scope: Scope) -> Any:
        """Read it; `scope` has what was read before."""

    def put(self, value: Any, scope: Scope) -> bytes:
        """The bytes of a value."""
        return b""

    def show(self, value: Any) -> Any:
        """A value in the form of reports."""
        return value


def formula(expression: str | int) -> Callable[[Scope], Any]:
    """The value of an expression in the names of a scope."""
    if isinstance(expression, int):
        return lambda scope: expression
    if expression.isidentifier():
        return operator.itemgetter(expression)
    code = compile(expression, "<declaration>", "eval")
    return lambda scope: eval(code, {}, scope)


class Field(Element):
    """A number, or an array whose length is known.

    Args:
        spelled: its type, as SPEC prints it.
        take: reads it.
        put: the bytes of a value.
        shown: the form of a value in reports.
    """

    def __init__(
        self,
        spelled: str,
        take: Callable[[ByteReader, Scope], Any],
        put: Callable[[Any, Scope], bytes],
        shown: Callable[[Any], Any] = lambda value: value,
    ) -> None:
        self.spelled, self._take, self._put, self._shown = spelled, take, put, shown

    def take(self, reader: ByteReader, scope: Scope) -> Any:
        return self._take(reader, scope)

    def put(self, value: Any, scope: Scope) -> bytes:
        return self._put(value, scope)

    def show(self, value: Any) -> Any:
        return self._shown(value)


def scalar(spelled: str, code: str, shown: Callable[[Any], Any] = lambda value: value) -> Field:
    """A number of a fixed size, by its code of the `struct` module."""
    packed = struct.Struct("<" + code)
    return Field(
        spelled,
        lambda reader, scope: packed.unpack(reader.take(packed.size))[0],
        lambda value, scope: packed.pack(value),
        shown,
    )


def stream_name(number: int) -> str:
    """The name of a stream kind in reports."""
    return f"{number} {Stream(number).name}" if number in set(Stream) else str(number)


U8, U32 = scalar("u8", "B"), scalar("u32", "L")


def varint(bits: int) -> Field:
    """An unsigned LEB128 integer below 2^bits (SPEC §5.7)."""
    return Field(
        f"varint({bits})", lambda reader, scope: reader.unsigned(bits), lambda value, scope: unsigned_varint(value)
    )


def varints(bits: int, number: str) -> Field:
    """(number,) int64: LEB128 integers below 2^bits, one after the other."""
    length = formula(number)
    return Field(
        f"{number} times varint({bits})",
        lambda reader, scope: reader.unsigned_array(bits, length(scope)),
        lambda value, scope: b"".join(map(unsigned_varint, value.tolist())),
    )


def array(dtype: str, number: str) -> Field:
    """(number,) numbers of a fixed size, little-endian.

    Args:
        dtype: their numpy type without byte order.
        number: how many.
    """
    length = formula(number)
    return Field(
        f"{number} times {_NUMBERS[dtype]}",
        lambda reader, scope: reader.array(f"<{dtype}", length(scope)),
        lambda value, scope: value if isinstance(value, bytes) else bytes(value.astype(f"<{dtype}").tobytes()),
    )


def _zigzag(values: Any) -> Any:
    return np.where(values >= 0, 2 * values, -2 * values - 1)


def _from_zigzag(numbers: Any) -> Any:
    return np.where(numbers & 1, -(numbers >> 1) - 1, numbers >> 1)


_MEANINGS: Mapping[str, tuple[Callable[[Any], Any], Callable[[Any], Any]]] = {
    "number": (lambda numbers: numbers, lambda values: values),
    "signed": (_from_zigzag, _zigzag),
    "f32": (lambda numbers: numbers.astype(np.uint32).view(np.float32), lambda values: values.view(np.uint32)),
    "xor f32": (
        lambda numbers: np.bitwise_xor.accumulate(numbers.astype(np.uint32)).view(np.float32),
        lambda values: values.view(np.uint32) ^ np.append(np.uint32(0), values[:-1].view(np.uint32)),
    ),
}
"""By the name that SPEC has for it: from (n,) int64 numbers to values, and back."""


class Number(Element):
    """Adaptive numbers, with a number model for each value of an expression (SPEC §8.5).

    Args:
        kind: ``number``, ``signed``, ``f32`` or ``xor f32``.
        times: how many, for an array; a single one otherwise.
        by: what chooses the number model, the name of the field aside.
        limit: the most a number may be, which then counts things.
        shown: the form of a value in reports.
    """

    def __init__(
        self,
        kind: str = "number",
        times: str = "",
        by: str = "",
        limit: int | None = None,
        shown: Callable[[Any], Any] = lambda value: value,
    ) -> None:
        spelled = kind if limit is None else f"count({limit})"
        self.spelled = (f"{times} times " if times else "") + spelled + (f"[{by}]" if by else "")
        self._times, self._by, self._limit = times and formula(times), by and formula(by), limit
        self._value, self._number = _MEANINGS[kind]
        self._shown = shown

    def take(self, reader: Any, scope: Scope) -> Any:
        if callable(self._times):
            return self._array(reader, scope, self._times(scope))
        reader.spend(1)
        number = reader.number(self._model(scope))
        if self._limit is not None and number > self._limit:
            raise _above(self.name, number, self._limit, reader.field)
        return self._value(np.array([number])).item()

    def _array(self, reader: Any, scope: Scope, length: int) -> Any:
        reader.spend(length)
        model = self._model(scope)
        return self._value(np.fromiter((reader.number(model) for _ in range(length)), np.int64, length))

    def put(self, value: Any, scope: Scope) -> bytes:
        model, writer = self._model(scope), scope["writer"]
        for number in self._number(np.atleast_1d(value).ravel()).tolist():
            writer.number(model, number)
        return b""

    def show(self, value: Any) -> Any:
        return self._shown(value)

    def _model(self, scope: Scope) -> tuple[str | None, Any]:
        return self.name, self._by(scope) if callable(self._by) else None


class ShiftedNumbers(Number):
    """(times,) int64 signed adaptive numbers that may share zero bits at their end (SPEC §8.5)."""

    def __init__(self, times: str) -> None:
        super().__init__("signed", times)
        self.spelled = f"{times} times shifted"

    def _array(self, reader: Any, scope: Scope, length: int) -> Any:
        reader.spend(1)
        shift = reader.number(self._shift)
        if shift > _MOST_SHIFT:
            raise _above(f"the shift of {self.name}", shift, _MOST_SHIFT, reader.field)
        values = super()._array(reader, scope, length) << shift
        if length and int(np.abs(values).max()) >> _MOST_SHIFT:
            raise Malformed("bad-number", f"{self.name}: a shifted number of more than 32 bits", field=reader.field)
        return values

    def put(self, value: Any, scope: Scope) -> bytes:
        values = np.asarray(value, np.int64).ravel()
        shared = int(np.bitwise_or.reduce(values, initial=0))
        shift = min((shared & -shared).bit_length() - 1, _MOST_SHIFT) if shared else 0
        scope["writer"].number(self._shift, shift)
        return super().put(values >> shift, scope)

    @property
    def _shift(self) -> tuple[str, str | None]:
        return "shift of", self.name


_MOST_SHIFT = 31


def _above(name: str | None, number: int, limit: int, field: str) -> LimitExceeded:
    return LimitExceeded("count-limit", f"{name} is {number}, at most {limit} allowed", field=field)


def blob(number: str | int) -> Field:
    """A number of bytes that another part reads."""
    length = formula(number)
    return Field(f"{number} bytes", lambda reader, scope: reader.take(length(scope)), lambda value, scope: value)


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
        self.check, self._holds, self._refusal = check, holds, refusal

    def take(self, reader: ByteReader, scope: Scope) -> None:
        if not self._holds(scope):
            raise self._refusal(scope)


class Derived(Element):
    """A value made of what was read; it takes no bytes.

    Args:
        made: makes it, and may refuse.
        text: how, as SPEC prints it; empty for what is no matter of the format.
        checks: what is checked.
    """

    def __init__(self, made: Callable[[Scope], Any], text: str = "", checks: Sequence[Check] = ()) -> None:
        self._made, self.text, self.checks = made, text, checks

    def take(self, reader: ByteReader, scope: Scope) -> Any:
        return self._made(scope)


class Record(Element):
    """Fields one after the other; read as a :class:`Scope` of their values, packed from any mapping of them."""

    def __init__(self, *members: Element) -> None:
        self.members = members

    def take(self, reader: ByteReader, scope: Scope) -> Scope:
        values = Scope(scope)
        self.fill(reader, values)
        return values

    def open(self, payload: bytes, field: str, trace: Trace | None, spend: Spend) -> Any:
        """A reader of a payload that is this record."""
        return ByteReader(payload, field, trace)

    def built(self, value: Mapping[str, Any], scope: Scope) -> bytes:
        """The payload of `value`."""
        return self.put(value, scope)

    def fill(self, reader: ByteReader, values: Scope) -> None:
        """Read the fields into `values`."""
        for element in self.members:
            if element.name is None:
                element.take(reader, values)
                continue
            if reader.trace is not None:
                reader.trace.enter(element.name, reader.position)
            value = values[element.name] = element.take(reader, values)
            if reader.trace is not None:
                reader.trace.leave(element.show(value), reader.position)

    def put(self, value: Mapping[str, Any], scope: Scope) -> bytes:
        values = Scope(scope)
        values.update(value)
        return self.put_members(values)

    def put_members(self, values: Scope) -> bytes:
        """The bytes of the fields, whose values are in scope."""
        return b"".join(
            element.put(None if element.name is None or isinstance(element, Derived) else values[element.name], values)
            for element in self.members
        )


class NumberRecord(Record):
    """A payload of adaptive numbers alone (SPEC §8.5). Positions that a trace hears count numbers."""

    def open(self, payload: bytes, field: str, trace: Trace | None, spend: Spend) -> Any:
        return NumberReader(payload, field, trace, spend)

    def built(self, value: Mapping[str, Any], scope: Scope) -> bytes:
        scope["writer"] = writer = NumberWriter()
        self.put(value, scope)
        return writer.finish()


class When(Element):
    """Members of the record around it that are there only under a condition."""

    def __init__(self, condition: str, *members: Element) -> None:
        self.condition, self.record = condition, Record(*members)
        self._holds = formula(condition)

    def take(self, reader: ByteReader, scope: Scope) -> None:
        if self._holds(scope):
            self.record.fill(reader, scope)

    def put(self, value: None, scope: Scope) -> bytes:
        return self.record.put_members(scope) if self._holds(scope) else b""


class Repeat(Element):
    """A list of items, `number` of them; an item sees its `index`, from 0, and the list of those `earlier`."""

    def __init__(self, number: str | int, item: Element) -> None:
        self.number, self.item = number, item
        self._length = formula(number)
        self.spelled = f"{number} times {item.spelled}"

    def take(self, reader: ByteReader, scope: Scope) -> list[Any]:
        out: list[Any] = []
        around = Scope(scope)
        around["earlier"] = out
        for index in range(self._length(scope)):
            around["index"] = index
            if reader.trace is not None:
                reader.trace.enter(index, reader.position)
            value = self.item.take(reader, around)
            if reader.trace is not None:
                reader.trace.leave(self.item.show(value), reader.position)
            out.append(value)
        return out

    def put(self, value: Sequence[Any], scope: Scope) -> bytes:
        around = Scope(scope)
        out = []
        for index, item in enumerate(value):
            around["index"] = index
            out.append(self.item.put(item, around))
        return b"".join(out)


class Use(Element):
    """A record declared elsewhere, under its name in SPEC and with its parameters."""

    def __init__(self, title: str, record: Element, **parameters: str | int) -> None:
        self.record = record
        self.spelled = f"{title}({', '.join(map(str, parameters.values()))})"
        self._parameters = [(name, formula(given)) for name, given in parameters.items()]

    def take(self, reader: ByteReader, scope: Scope) -> Any:
        around = Scope(scope)
        around.update((name, given(scope)) for name, given in self._parameters)
        return self.record.take(reader, around)

    def put(self, value: Any, scope: Scope) -> bytes:
        return self.record.put(value, scope)


def read(
    record: Record,
    payload: bytes,
    field: str,
    trace: Trace | None = None,
    spend: Spend = lambda count: True,
    **parameters: Any,
) -> Scope:
    """The fields of a payload, which must be exactly `record`.

    Args:
        field: what errors call it.
        trace: hears where every field lies.
        spend: takes adaptive numbers from what is allowed.
        parameters: what the declaration needs to know beforehand.

    Raises:
        Malformed: ``payload-short``, ``payload-long``, ``bad-varint``, or what a rule refuses; of numbers
            ``rans-length``, ``rans-last-word``, ``bad-number``, ``rans-seal``.
        LimitExceeded: ``count-limit``, ``limit-expansion``.
    """
    reader = record.open(payload, field, trace, spend)
    around = Scope({})
    around.update(parameters)
    values = record.take(reader, around)
    reader.finish()
    return values


def build(record: Record, values: Mapping[str, Any], **parameters: Any) -> bytes:
    """The payload of `values`: the inverse of :func:`read`. Counts must be among them."""
    around = Scope({})
    around.update(parameters)
    return record.built(values, around)
