"""Rules, sections and files that code, comments and messages cite exist."""

from __future__ import annotations

import re

from conformance.spec.spec_text import rules
from conformance.spec.spec_text import text as spec_text
from tests.conftest import REPOSITORY
from tests.test_conventions import LANGUAGES, sources

RULES = set(rules())
SECTIONS = set(re.findall(r"^#+ (?:Appendix )?((?:\d+|[A-Z])(?:\.\d+)*)\.? ", spec_text(), re.MULTILINE))
PAPER = {
    *("1", "2", "2.1", "2.2", "2.3", "3", "3.1", "3.2", "3.3", "3.4", "3.5", "3.6", "3.7"),
    *("4", "4.1", "5", "5.1", "5.2", "5.3", "5.4", "5.5", "6"),
}
"""Numbered sections of SCAR-GS, which docs/under-the-hood.md identifies."""
INVENTING = ("tests/blocks/test_declare.py", "tests/conformance/spec/test_rules.py", "tests/test_citations.py")
"""Tests of what reads rules: they make up some."""
NAMES = [name for name in sources((*LANGUAGES, ".toml")) if name not in INVENTING]

RULE = re.compile(r"\bR-[0-9A-Z]+(?:\.\d+)*-\d+\b")
SECTION = re.compile(r"§ ?((?:\d+|[A-Z])(?:\.\d+)*)")
DOCUMENT = re.compile(r"SPEC|paper|RFC \d+|Scaffold-GS")


def cited_sections(text: str) -> list[tuple[str, str]]:
    """(document, section) of each ``§``: the document named last in the sentence before it, else SPEC."""
    found = []
    for match in SECTION.finditer(text):
        sentence = re.split(r"\.\s|\n\n", text[max(0, match.start() - 200) : match.start()])[-1]
        named = DOCUMENT.findall(sentence)
        found.append((named[-1] if named else "SPEC", match[1]))
    return found


def test_cited_rules_exist() -> None:
    """A rule that was renumbered in SPEC.md is renumbered everywhere."""
    assert len(RULES) > 150
    cited = {(name, rule) for name in NAMES for rule in RULE.findall((REPOSITORY / name).read_text("utf-8"))}
    assert len(cited) > 450
    assert sorted(one for one in cited if one[1] not in RULES) == []


def test_cited_sections_exist() -> None:
    known = {"SPEC": SECTIONS, "paper": PAPER}
    cited = {(name, *one) for name in NAMES for one in cited_sections((REPOSITORY / name).read_text("utf-8"))}
    assert len(cited) > 450
    missing = [one for one in cited if one[1] in known and one[2] not in known[one[1]]]
    assert sorted(missing) == []


PATH = re.compile(
    r"(?<![\w/])((?:docs|scarfmt|conformance|examples|benchmarks)/(?:[\w.-]+/)*[\w-]+\.(?:md|py|ply|c|h))\b"
)
HISTORY = "docs/decisions/"


def test_files_named_in_code_exist() -> None:
    """Docstrings and comments send readers to files that are there; decision records may be named by number alone."""
    named = {
        (name, path)
        for name in NAMES
        if not name.startswith(("tests/", "web/", "benchmarks/"))
        for path in PATH.findall((REPOSITORY / name).read_text("utf-8"))
    }
    assert named
    assert sorted(one for one in named if not one[1].startswith(HISTORY) and not (REPOSITORY / one[1]).exists()) == []
