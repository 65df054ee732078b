"""The page of all commands has every command, and what it prints of itself."""

from __future__ import annotations

from click.testing import CliRunner

from docs.site.commands import WIDTH, commands, help_text, page
from scarfmt.cli import cli


def test_help_is_what_the_command_prints() -> None:
    """Another way to make the text could say what no user ever sees."""
    command = cli.commands["encode"]
    printed = CliRunner().invoke(cli, ["encode", "--help"], prog_name="scarfmt", terminal_width=WIDTH).output
    assert help_text("scarfmt encode", command).strip() == printed.removeprefix("Usage: ").join(["Usage: ", ""]).strip()


def test_commands_of_commands_are_there() -> None:
    names = [name for name, _ in commands()]
    assert names[0] == "scarfmt"
    assert {"scarfmt encode", "scarfmt conformance", "scarfmt conformance run"} <= set(names)
    assert all(f"## {name}\n" in page() for name in names)
