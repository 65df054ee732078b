"""The table of contents of SPEC.md, from its headings."""

from __future__ import annotations

import re

_HEADING = re.compile(r"^(#{2,3}) (.+)$", re.MULTILINE)
_FENCE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
_ITSELF = "Contents"


def slug(heading: str) -> str:
    """The anchor that GitHub gives a heading."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


def contents(text: str) -> str:
    """A list of links to the sections of `text`, one line each; subsections are indented below theirs."""
    found = [(len(match[1]), match[2]) for match in _HEADING.finditer(_FENCE.sub("", text)) if match[2] != _ITSELF]
    return "".join(f"{'  ' * (depth - 2)}- [{title}](#{slug(title)})\n" for depth, title in found)
