"""`scarfmt conformance`: imports its commands from the distribution scarfmt-conformance when they are first used."""

from __future__ import annotations

import importlib

import click

from scarfmt.errors import InvalidInput

_DISTRIBUTION = "scarfmt_conformance"
_ABSENT = (
    "this needs the package scarfmt-conformance, in the folder conformance/suite of scarfmt's repository: "
    "pip install ./conformance/suite"
)


class _Elsewhere(click.Group):
    """A command group that takes its commands and help from the other distribution, if that is installed."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        try:
            return _commands().list_commands(ctx)
        except InvalidInput:
            return []

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        return _commands().get_command(ctx, cmd_name)

    def format_help(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        try:
            _commands().format_help(ctx, formatter)
        except InvalidInput:
            super().format_help(ctx, formatter)


def _commands() -> click.Group:
    """The group with the commands.

    Raises:
        InvalidInput: ``input-dependency``: the distribution is not installed.
    """
    try:
        module = importlib.import_module(f"{_DISTRIBUTION}.command")
    except ModuleNotFoundError as error:
        if error.name != _DISTRIBUTION:
            raise
        raise InvalidInput("input-dependency", _ABSENT) from error
    group = module.conformance
    assert isinstance(group, click.Group)
    return group


conformance = _Elsewhere("conformance", help=_ABSENT)
