"""`scarfmt conformance` where its distribution is, and is not, installed."""

from __future__ import annotations

import sys

import pytest
from scarfmt_conformance.command import conformance as commands

from scarfmt.cli.conformance import conformance
from tests.cli.conftest import run


def test_commands_and_help_are_those_of_the_distribution() -> None:
    """Nothing is listed twice, so nothing can differ."""
    result = run("conformance", "--help")
    assert result.exit_code == 0
    assert all(f"\n  {name} " in result.stdout for name in commands.commands)
    assert conformance.get_short_help_str() == commands.get_short_help_str()


class _Absent:
    """A finder that finds no distribution of that name."""

    def find_spec(self, name: str, *_: object) -> None:
        if name == "scarfmt_conformance":
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


@pytest.fixture
def absent(monkeypatch: pytest.MonkeyPatch) -> None:
    """The distribution is not installed."""
    for name in [name for name in sys.modules if name.split(".")[0] == "scarfmt_conformance"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "meta_path", [_Absent(), *sys.meta_path])


@pytest.mark.usefixtures("absent")
@pytest.mark.parametrize("arguments", [["run"], ["list", "--help"]])
def test_without_it_one_line_says_how_to_get_it(arguments: list[str]) -> None:
    """No traceback, and a command that exists."""
    result = run("conformance", *arguments)
    assert result.exit_code == 1
    (line,) = result.stderr.splitlines()
    assert "pip install ./conformance/suite" in line


@pytest.mark.usefixtures("absent")
def test_the_list_of_commands_works_without_it() -> None:
    assert "conformance" in run("--help").stdout
    assert run("conformance", "--help").exit_code == 0
