"""Pages for whoever changes the code name files, sections and anchors that exist."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.conftest import REPOSITORY

PAGES = [
    REPOSITORY / "README.md",
    REPOSITORY / "SPEC.md",
    REPOSITORY / "CONTRIBUTING.md",
    REPOSITORY / "SECURITY.md",
    *sorted((REPOSITORY / "docs").glob("*.md")),
    *sorted((REPOSITORY / "docs" / "decisions").glob("*.md")),
]
_MADE = ("fuzz/findings/",)
"""Folders that commands make."""
_ROOTS = (
    *("scarfmt", "reference_encoder", "reference_decoder", "conformance", "tests", "fuzz", "benchmarks", "docs"),
    "release",
)


def _slug(heading: str) -> str:
    """The anchor that GitHub gives a heading."""
    kept = re.sub(r"[^\w\- ]", "", heading.strip().lower())
    return kept.replace(" ", "-")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(REPOSITORY)))
def test_links_lead_somewhere(page: Path) -> None:
    """Every relative link names a file of the repository, and its anchor a heading of that file."""
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text()):
        if "://" in target:
            continue
        path, _, anchor = target.partition("#")
        found = (page.parent / path).resolve() if path else page
        assert found.exists(), f"{target}: no such file"
        if anchor:
            headings = re.findall(r"^#+ (.*)$", found.read_text(), re.M)
            assert anchor in map(_slug, headings), f"{target}: no such heading"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(REPOSITORY)))
def test_files_that_are_named_exist(page: Path) -> None:
    """A path in backquotes that starts with a folder of the repository is there."""
    for name in re.findall(r"`([\w./-]+)`", page.read_text()):
        if name.split("/")[0] in _ROOTS and "/" in name and name not in _MADE:
            assert (REPOSITORY / name).exists(), f"{name}: no such file"


def test_sections_of_the_specification_that_the_map_names_exist() -> None:
    """Architecture, references and recipes cite sections of SPEC.md that are there."""
    sections = set(re.findall(r"^#+ (\d+(?:\.\d+)?)\.? ", (REPOSITORY / "SPEC.md").read_text(), re.M))
    for name in ("architecture", "changing-the-format"):
        for cited in re.findall(r"§(\d+(?:\.\d+)?)", (REPOSITORY / "docs" / f"{name}.md").read_text()):
            assert cited in sections, f"{name}: SPEC has no §{cited}"


def test_the_map_names_the_files_in_its_pictures() -> None:
    """File names in the pictures of decoding and encoding are those of modules."""
    known = {path.name for root in _ROOTS for path in (REPOSITORY / root).rglob("*.py")}
    text = (REPOSITORY / "docs" / "architecture.md").read_text()
    for name in re.findall(r"\b(\w+\.py)\b", text):
        assert name in known, f"{name}: no such module"
