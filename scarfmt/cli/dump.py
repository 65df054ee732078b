"""`scarfmt dump`: every byte of a file, annotated."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import click

from scarfmt.cli.failures import FAILED
from scarfmt.cli.files import check_stdout, open_input, timeout_option
from scarfmt.container.registries import BlockKind
from scarfmt.errors import printable

if TYPE_CHECKING:
    from scarfmt.tools.dump import Dump
    from scarfmt.tools.fields import Row

_KINDS = [kind.name for kind in BlockKind]
_HEAD = f"{'offset':>10} {'length':>8}  {'field':<56} {'SPEC':<5} value"


@click.command()
@click.argument("file")
@click.option("--json", "as_json", is_flag=True, help="Print a JSON object on stdout: rows and refusals.")
@click.option("--full", is_flag=True, help="Print all items of long lists, not only the first ones.")
@click.option(
    "--block",
    "blocks",
    multiple=True,
    type=click.Choice(_KINDS, case_sensitive=False),
    help="List only blocks of this kind; repeatable.",
)
@timeout_option
@click.pass_context
def dump(ctx: click.Context, file: str, as_json: bool, full: bool, blocks: tuple[str, ...]) -> None:
    """List all bytes of FILE (a path, a URL or -): the field, its value, and the section of SPEC.md that defines it.

    Every byte belongs to one row. The row of a block of adaptive numbers is followed by those of its fields, whose
    offsets are marked + and count its numbers. Symbols inside sub-streams are not decoded. A damaged file is listed as
    far as it can be read. The faults come last, on stderr, and the exit code is 1.

    \b
    Examples:
      scarfmt dump scene.scar | less
      scarfmt dump scene.scar --block LAYER --block TABLES
    """
    from scarfmt.tools.dump import Dump

    kinds = {BlockKind[name.upper()] for name in blocks} or None
    check_stdout()
    with open_input(file) as source:
        annotated = Dump(source, full=full, kinds=kinds)
        for line in _json_lines(annotated) if as_json else _text_lines(annotated):
            click.echo(line)
    for error in annotated.refusals:
        click.echo(f"error: {error}", err=True)
    if annotated.refusals:
        ctx.exit(FAILED)


def _text_lines(annotated: Dump) -> Iterator[str]:
    yield _HEAD
    for row in annotated.rows():
        yield _line(row)


def _line(row: Row) -> str:
    offset = f"+{row.offset}" if row.content else str(row.offset)
    return f"{offset:>10} {row.length:>8}  {row.field:<56} {row.section:<5} {printable(str(row.value))}".rstrip()


def _json_lines(annotated: Dump) -> Iterator[str]:
    """One JSON object, a row a line: a file may have more rows than memory."""
    import json

    yield '{"rows": ['
    before = ""
    for row in annotated.rows():
        if before:
            yield f"{before},"
        # JSON has no infinities.
        value = row.value if not isinstance(row.value, float) or math.isfinite(row.value) else str(row.value)
        before = json.dumps({**asdict(row), "value": value})
    if before:
        yield before
    refusals: list[dict[str, Any]] = [
        {"refusal": error.refusal, "message": error.message, "offset": error.offset, "field": error.field}
        for error in annotated.refusals
    ]
    yield f'], "refusals": {json.dumps(refusals)}}}'
