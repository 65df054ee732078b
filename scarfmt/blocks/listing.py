"""Declarations as SPEC.md prints them: one line a field, with its type and what it means."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from scarfmt.blocks.declare import (
    Bits,
    Blob,
    Check,
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
_TYPES = 27
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


def listing(title: str, record: Record) -> str:
    """A declaration in a few lines, `title` the first."""
    rows = list(_rows(record, 1))
    width = max(_INDENT * depth + len(name) for depth, name, kind, _ in rows if kind) + 2
    lines = [f"{title}:"]
    for depth, name, kind, remark in rows:
        text = " " * _INDENT * depth + name
        text = f"{text:{width}}{kind}" if kind else text
        lines.append(f"{text:{width + _TYPES}}  # {remark}" if remark else text)
    return "\n".join(lines) + "\n"


_Row = tuple[int, str, str, str]
"""Depth, name or what stands in its place, type, remark."""


def _rows(record: Record, depth: int) -> Iterator[_Row]:
    for member in record.members:
        yield from _member_rows(member, depth)


def _member_rows(member: Any, depth: int) -> Iterator[_Row]:
    element, name = unnamed(member), member.name
    if isinstance(element, When):
        yield depth, f"if {expression_text(element.condition)}:", "", ""
        yield from _rows(element.record, depth + 1)
    elif isinstance(element, Rule):
        yield depth, *_checked(element.check)
    elif isinstance(element, Derived):
        if element.text:
            yield depth, f"{name} = {element.text}", "", ""
        for check in element.checks:
            yield depth, *_checked(check)
    elif isinstance(element, Repeat) and isinstance(element.item, Record):
        yield depth, name, f"{expression_text(element.count)} times:", member.docs
        yield from _rows(element.item, depth + 1)
    else:
        yield depth, name, spelled(element), member.docs


def _checked(check: Check) -> tuple[str, str, str]:
    return f"check {check.number}: {check.holds}", "", f"else {check.otherwise}"


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
