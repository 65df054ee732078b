"""pyproject.toml: what an installation brings, and that messages and pages name extras that exist."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

import scarfmt
from tests.conftest import REPOSITORY

PROJECT: dict[str, Any] = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS: dict[str, list[str]] = PROJECT["optional-dependencies"]
SUITE: dict[str, Any] = tomllib.loads((REPOSITORY / "conformance" / "suite" / "pyproject.toml").read_text())["project"]

NAMED = re.compile(
    r"pip install (?:-e )?'(?:scarfmt|\.|[\w./-]+\.whl)\[([\w,]+)\]'|missing_package\([^)]*, \"(\w+)\"\)"
)
TEXTS = [
    REPOSITORY / "README.md",
    *sorted((REPOSITORY / "docs").glob("*.md")),
    *sorted(path for package in ("scarfmt", "reference_decoder") for path in (REPOSITORY / package).rglob("*.py")),
]


def names(requirements: list[str]) -> set[str]:
    return {re.split(r"[\s<>=\[;]", requirement)[0] for requirement in requirements}


def test_the_library_pins_no_exact_version_that_others_may_need_otherwise() -> None:
    """An exact pin of torch in a library makes it impossible to install beside most others."""
    used = [one for extra, found in EXTRAS.items() if extra != "dev" for one in found]
    assert not [one for one in (*PROJECT["dependencies"], *used) if "==" in one]


def test_only_training_brings_torch_and_a_compiler_of_python() -> None:
    assert not names(EXTRAS["render"]) & {"torch", "numba"}
    assert {"torch", "numba"} | names(EXTRAS["render"]) <= names(EXTRAS["train"])


@pytest.mark.parametrize("path", [path for path in TEXTS if NAMED.search(path.read_text(encoding="utf-8"))], ids=str)
def test_extras_named_exist(path: Path) -> None:
    for found in NAMED.finditer(path.read_text(encoding="utf-8")):
        assert set((found[1] or found[2]).split(",")) <= set(EXTRAS), found[0]


def test_the_guide_lists_every_extra_and_what_it_brings() -> None:
    guide = (REPOSITORY / "docs" / "compress.md").read_text(encoding="utf-8")
    found = re.findall(r"^\| `?(\w+)`? \|.*\| (.*) \|$", guide, re.M)
    rows = {name: set(brought.split(", ")) for name, brought in found}
    needed = {"none": PROJECT["dependencies"], **EXTRAS}
    del needed["dev"]
    assert {name: rows.get(name) for name in needed} == {name: names(wanted) for name, wanted in needed.items()}


def test_the_version_is_written_once_and_others_take_or_repeat_it() -> None:
    """Distributions take it; the npm package, the citation and the change log repeat it, the latter with one date."""
    assert PROJECT["dynamic"] == SUITE["dynamic"] == ["version"]
    browser = json.loads((REPOSITORY / "web" / "package.json").read_text(encoding="utf-8"))
    assert browser["version"] == scarfmt.__version__
    citation = (REPOSITORY / "CITATION.cff").read_text(encoding="utf-8")
    (date,) = re.findall(r"^date-released: ([\d-]+)$", citation, re.M)
    assert re.findall(r"^version: (\S+)$", citation, re.M) == [scarfmt.__version__]
    changes = (REPOSITORY / "CHANGELOG.md").read_text(encoding="utf-8")
    headings = re.findall(r"^## \[(.+)\]( - [\d-]+)?$", changes, re.M)
    assert headings[:2] == [("Unreleased", ""), (scarfmt.__version__, f" - {date}")]
