"""Navigation is what the tables of docs/README.md list, and they list every page."""

from __future__ import annotations

import pytest

from docs.site.navigation import listed, with_navigation
from tests.conftest import REPOSITORY

DOCS = REPOSITORY / "docs"


def test_only_links_of_a_first_column_are_listed() -> None:
    """A page that is merely mentioned would appear in the navigation twice."""
    text = "| page | for |\n|---|---|\n| [A](a.md), [B](../b.md) | see [C](c.md) |\n\n[D](d.md)\n"
    assert listed(text) == ["a", "../b"]


def test_each_section_has_its_own_part_of_the_navigation() -> None:
    text = "# Top\n\nintro\n\n## One\n\n| [A](a.md) | x |\n\n## Two\n\nwords\n"
    made = with_navigation(text)
    assert made.count("```{toctree}") == 1
    assert made.index("## One") < made.index(":caption: One\n\na\n```") < made.index("## Two")


@pytest.mark.parametrize("folder", ["", "decisions"])
def test_every_page_is_listed(folder: str) -> None:
    """`make docs` reports a page that no table lists only much later."""
    index = DOCS / folder / "README.md"
    pages = {path.relative_to(index.parent).with_suffix("").as_posix() for path in index.parent.rglob("*.md")}
    missing = {page for page in pages - set(listed(index.read_text(encoding="utf-8"))) if page != "README"}
    assert not {page for page in missing if folder or not page.startswith("decisions/")}
