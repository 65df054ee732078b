"""A check of the built site: it asks nothing of other hosts.

Links that a reader follows may lead anywhere. What a browser fetches by itself may not: scripts, styles, pictures,
fonts.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

_REMOTE = re.compile(r"(?:https?:)?//", re.IGNORECASE)
_IN_STYLE = re.compile(r"(?:url\(|@import\s+)\s*[\"']?((?:https?:)?//[^\"')\s]+)", re.IGNORECASE)
_FOLLOWED = {"a"}
"""Elements whose address is fetched when somebody asks for it."""
_NOT_FETCHED = {"canonical", "next", "prev", "author", "license"}


class _Fetched(HTMLParser):
    """Collects remote addresses that a page makes a browser fetch."""

    def __init__(self) -> None:
        super().__init__()
        self.remote: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        named = dict(attrs)
        if tag in _FOLLOWED or (named.get("rel") or "") in _NOT_FETCHED:
            return
        for name in ("src", "href", "srcset", "poster", "data"):
            address = named.get(name) or ""
            if _REMOTE.match(address):
                self.remote.append(address)
        self.remote += _IN_STYLE.findall(named.get("style") or "")


def remote(path: Path) -> list[str]:
    """Addresses on other hosts that an HTML page or a style sheet loads by itself."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".css":
        return _IN_STYLE.findall(text)
    page = _Fetched()
    page.feed(text)
    return page.remote


def found(folder: Path) -> Iterator[str]:
    """A line for each such address in the pages and style sheets of `folder`."""
    for path in sorted(folder.rglob("*")):
        if path.suffix in (".html", ".css"):
            yield from (f"{path.relative_to(folder)}: {address}" for address in remote(path))


if __name__ == "__main__":
    lines = list(found(Path(sys.argv[1])))
    print("\n".join(lines) or "nothing is loaded from another host")
    sys.exit(bool(lines))
