"""The table of contents of SPEC.md, from its headings."""

from __future__ import annotations

import re
import textwrap

_HEADING = re.compile(r"^(#{2,3}) (.+)$", re.MULTILINE)
_FENCE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
_WIDTH = 120


def slug(heading: str) -> str:
    """The anchor that GitHub gives a heading."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


def contents(text: str) -> str:
    """A list of links to the chapters of `text`, each followed by the titles of its sections."""
    lines: list[str] = []
    for depth, title in _HEADING.findall(_FENCE.sub("", text)):
        if len(depth) == 2:
            lines.append(f"- [{title}](#{slug(title)})")
        else:
            lines[-1] += f"{' ·' if ': ' in lines[-1] else ':'} {title}"
    return "".join(textwrap.fill(line, _WIDTH, subsequent_indent="  ") + "\n" for line in lines[1:])
