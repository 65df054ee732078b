"""The page of all commands: what `scarfmt COMMAND --help` prints."""

from __future__ import annotations

from collections.abc import Iterator

import click

from scarfmt.cli import cli

WIDTH = 88


def commands(command: click.Command = cli, name: str = "scarfmt") -> Iterator[tuple[str, click.Command]]:
    """`command` and all below it, each with its name in full, in alphabetic order."""
    yield name, command
    if isinstance(command, click.Group):
        context = click.Context(command, info_name=name)
        for key in command.list_commands(context):
            below = command.get_command(context, key)
            if below is not None and not below.hidden:
                yield from commands(below, f"{name} {key}")


def help_text(name: str, command: click.Command) -> str:
    """The help of a command, on a terminal of `WIDTH` columns."""
    context = click.Context(command, info_name=name, terminal_width=WIDTH, max_content_width=WIDTH)
    context.help_option_names = list(cli.context_settings["help_option_names"])
    return command.get_help(context)


def page() -> str:
    """Markdown: a section for each command."""
    return "\n".join(f"## {name}\n\n```text\n{help_text(name, command)}\n```\n" for name, command in commands())
