"""Navigation of the site: the tables of a page that lists others.

Who reads the files in a checkout has the same order before him, and it is written once.
"""

from __future__ import annotations

import re

_HEADING = re.compile(r"^## (.+)$", re.MULTILINE)
_ROW = re.compile(r"^\| (.*?)(?:(?<!\\)\|)", re.MULTILINE)
_LINK = re.compile(r"\]\(([^)#\s]+)\.md\)")


def listed(text: str) -> list[str]:
    """Pages that the first column of tables in `text` links to, as paths without `.md`, in their order."""
    return [page for row in _ROW.findall(text) for page in _LINK.findall(row)]


def with_navigation(text: str) -> str:
    """Markdown of a page with a hidden list of contents behind each of its sections that lists pages."""
    parts = _HEADING.split(text)
    done = [parts[0], _contents(parts[0], "")]
    for heading, section in zip(parts[1::2], parts[2::2], strict=True):
        done += [f"## {heading}", section, _contents(section, heading)]
    return "".join(done)


def _contents(section: str, caption: str) -> str:
    pages = listed(section)
    if not pages:
        return ""
    options = [":hidden:", ":titlesonly:", *([f":caption: {caption}"] if caption else [])]
    return "\n".join(["", "```{toctree}", *options, "", *pages, "```", "", ""])
