"""Pages and the results they show: no figure without its date, and none that has another date than its file."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from benchmarks.pages import CAMPAIGNS, SHOWN, Shown
from benchmarks.report import RESULTS, SHORT_RESULTS
from docs.site.navigation import listed
from tests.conftest import REPOSITORY

PAGES = [REPOSITORY / "README.md", REPOSITORY / "examples" / "README.md", *sorted((REPOSITORY / "docs").rglob("*.md"))]


INDEX = (REPOSITORY / "docs" / "README.md").read_text(encoding="utf-8")
MEASUREMENTS = [page for page in listed(INDEX.split("## Measurements")[1].split("## ")[0]) if page != "compare"]
"""Pages of figures; the comparison with other formats begins with where those are better."""
SETTINGS = {("docs/encoder-effort.md", "efforts"), ("docs/trained.md", "trained-plan")}
"""Sections that show what is set, not what was measured: other tests hold them to the code."""


@pytest.mark.parametrize("shown", SHOWN, ids=lambda shown: f"{shown.page} {shown.section} {shown.results.stem}")
def test_a_page_says_from_when_and_where_its_figures_are(shown: Shown) -> None:
    """The page has the date of the file of results. Figures measured again without rewriting the page would fail
    here."""
    assert shown.dated()


def test_every_section_that_is_written_shows_known_results() -> None:
    """A new table with markers has to be listed, and with it gets a date; empty sections show nothing yet."""
    found = {
        (str(page.relative_to(REPOSITORY)), section)
        for page in PAGES
        for section in re.findall(r"<!-- (\S+):begin -->\n(?!<!-- \1:end)", page.read_text(encoding="utf-8"))
    }
    assert found - SETTINGS == {(shown.page, shown.section) for shown in SHOWN}


def test_every_file_of_results_is_shown() -> None:
    """Figures that no page shows would grow old unseen."""
    files = {path for folder in (RESULTS, CAMPAIGNS) for path in folder.glob("*.json")}
    assert files == {shown.results for shown in SHOWN}


def test_a_page_with_another_date_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The check itself can fail."""
    shown = SHOWN[0]
    changed = tmp_path / "results.json"
    text = shown.results.read_text(encoding="utf-8")
    date = re.search(r'"date": "([\d-]+)"', text)
    assert date is not None
    changed.write_text(text.replace(date[1], "1999-01-01"), encoding="utf-8")
    assert not Shown(shown.page, shown.section, changed).dated()
    assert RESULTS != SHORT_RESULTS


@pytest.mark.parametrize("page", MEASUREMENTS)
def test_what_was_not_measured_is_said_first(page: str) -> None:
    """Who reads figures has to know what they leave out before, not after."""
    text = (REPOSITORY / "docs" / f"{page}.md").read_text(encoding="utf-8")
    assert re.findall(r"^## (.*)$", text, re.MULTILINE)[0] == "Not measured here"
