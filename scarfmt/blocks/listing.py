"""Declarations as SPEC.md prints them: one line a field, with its type and what it means."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from scarfmt.blocks.declare import (
    Bits,
    Blob,
    Derived,
    Element,
    Numbers,
    Record,
    Repeat,
    Rule,
    Use,
    Varints,
    When,
    unnamed,
)

_INDENT = 4
_NAMES = 22
_TYPES = 20
_NAME = re.compile(r"this\['(\w+)'\]")


def expression_text(expression: Any) -> str:
    """An expression of construct as SPEC writes it."""
    text = _NAME.sub(r"\1", repr(expression))
    while text.startswith("(") and text.endswith(")") and _closes_last(text):
        text = text[1:-1]
    return text


def _closes_last(text: str) -> bool:
    depth = 0
    for place, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if depth == 0:
            return place == len(text) - 1
    return False


def listing(title: str, record: Record) -> list[str]:
    """The lines of a declaration, `title` the first."""
    return [f"{title}:", *_lines(record, _INDENT)]


def _lines(record: Record, indent: int) -> Iterator[str]:
    for member in record.members:
        yield from _member_lines(member, indent)


def _member_lines(member: Any, indent: int) -> Iterator[str]:
    element, name = unnamed(member), member.name
    if isinstance(element, When):
        yield " " * indent + f"if {expression_text(element.condition)}:"
        yield from _lines(element.record, indent + _INDENT)
    elif isinstance(element, Rule):
        yield _line(indent, "", "", f"check {element.number}")
    elif isinstance(element, Derived):
        yield from _derived_lines(element, name, indent)
    elif isinstance(element, Repeat) and isinstance(element.item, Record):
        yield _line(indent, name, f"{expression_text(element.count)} times:", member.docs)
        yield from _lines(element.item, indent + _INDENT)
    else:
        yield _line(indent, name, spelled(element), member.docs)


def _derived_lines(element: Derived, name: str, indent: int) -> Iterator[str]:
    if element.text:
        yield " " * indent + f"{name} = {element.text}"
    if element.rules:
        yield _line(indent, "", "", "check " + ", ".join(element.rules))


def _line(indent: int, name: str, kind: str, remark: str) -> str:
    text = " " * indent + f"{name:{_NAMES - indent}} {kind}"
    return f"{text:{_NAMES + _TYPES}}  # {remark}" if remark else text.rstrip()


def spelled(element: Element) -> str:
    """The type of a field, as SPEC writes it."""
    if isinstance(element, Repeat):
        return f"{expression_text(element.count)} times {spelled(element.item)}"
    if isinstance(element, Use):
        values = ", ".join(expression_text(value) for value in element.parameters.values())
        return f"{element.title}({values})"
    if isinstance(element, Bits):
        return f"{'shifted' if element.shifted else 'rice'}({expression_text(element.count)})"
    if isinstance(element, Varints):
        return f"{expression_text(element.count)} times {element.item}"
    if isinstance(element, Numbers):
        kinds = " or ".join(_NUMPY[kind] for kind in element.dtypes.values())
        return f"{expression_text(element.count)} times {kinds}"
    if isinstance(element, Blob):
        return f"{expression_text(element.count)} bytes"
    return str(element.spelled)


_NUMPY = {"u1": "u8", "i1": "i8", "i2": "i16", "f4": "f32"}
