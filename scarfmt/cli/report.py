"""Reports of commands: a few lines for people, or with --json a document for programs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from typing import Any

import click

from scarfmt.cli.files import STANDARD, check_stdout, print_json


@dataclass(frozen=True)
class Report:
    """What a command has to say when it is done.

    Attributes:
        document: JSON-able.
        text: for people, without the last line end; may be empty.
        table: whether the text is what was asked for, and goes to stdout.
        code: exit code.
    """

    document: dict[str, Any]
    text: str
    table: bool = False
    code: int = 0


def reports(command: Callable[..., Report]) -> Callable[..., None]:
    """A decorator that adds --json, and prints what the command returns. With --quiet, only the document is printed."""

    @click.option("--json", "as_json", is_flag=True, help="Print a JSON object on stdout.")
    @click.pass_context
    @wraps(command)
    def run(ctx: click.Context, /, *args: Any, as_json: bool, **kwargs: Any) -> None:
        if as_json:
            check_stdout()
            if ctx.params.get("output") == STANDARD:
                raise click.UsageError("--json prints on standard output: give OUTPUT a file name")
        found = command(*args, **kwargs)
        if as_json:
            print_json(found.document)
        elif found.text and not ctx.params.get("quiet"):
            click.echo(found.text, err=not found.table)
        ctx.exit(found.code)

    return run
