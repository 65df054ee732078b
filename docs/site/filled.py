"""The additions of the site to pages of the repository: navigation, and interfaces as the code has them."""

from __future__ import annotations

from collections.abc import Callable

from sphinx.application import Sphinx

from docs.site import commands, javascript, python
from docs.site.navigation import with_navigation

LISTS = ("docs/README", "docs/decisions/README")
"""Pages whose tables are the navigation."""
FILLED: dict[str, Callable[[], str]] = {
    "docs/reference/commands": commands.page,
    "docs/reference/python": python.page,
    "docs/reference/javascript": javascript.page,
}
"""Pages that end in what the code says of itself."""


def read(_app: Sphinx, name: str, source: list[str]) -> None:
    """Changes `source`, a list of one text."""
    if name in LISTS:
        source[0] = with_navigation(source[0])
    if name in FILLED:
        source[0] += "\n" + FILLED[name]()


def setup(app: Sphinx) -> dict[str, bool]:
    """The function that Sphinx calls."""
    app.connect("source-read", read)
    return {"parallel_read_safe": True}
