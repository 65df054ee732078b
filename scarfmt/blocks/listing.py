"""Declarations as SPEC.md prints them: one line a field, with its type and what it means."""

from __future__ import annotations

from collections.abc import Iterator

from scarfmt.blocks.declare import Check, Derived, Element, Record, Repeat, Rule, When

_INDENT = 4
_TYPES = 27

_Row = tuple[int, str, str, str]
"""Depth, name or what stands in its place, type, remark."""


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


def _rows(record: Record, depth: int) -> Iterator[_Row]:
    for member in record.members:
        yield from _member_rows(member, depth)


def _member_rows(member: Element, depth: int) -> Iterator[_Row]:
    name = member.name or ""
    if isinstance(member, When):
        yield depth, f"if {member.condition}:", "", ""
        yield from _rows(member.record, depth + 1)
    elif isinstance(member, Rule):
        yield depth, *_describe_check(member.check)
    elif isinstance(member, Derived):
        if member.text:
            yield depth, f"{name} = {member.text}", "", ""
        for check in member.checks:
            yield depth, *_describe_check(check)
    elif isinstance(member, Repeat) and isinstance(member.item, Record):
        yield depth, name, f"{member.number} times:", member.docs
        yield from _rows(member.item, depth + 1)
    else:
        yield depth, name, member.spelled, member.docs


def _describe_check(check: Check) -> tuple[str, str, str]:
    return f"check {check.number}: {check.holds}", "", f"else {check.otherwise}"
