"""`scarfmt validate`: every rule the file breaks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from scarfmt.cli.failures import FAILED
from scarfmt.cli.files import open_input, print_json, timeout_option
from scarfmt.cli.progress import progress

if TYPE_CHECKING:
    from scarfmt.tools.validate import Finding, Validation


@click.command(short_help="List every rule a file breaks.")
@click.argument("file")
@click.option("--json", "as_json", is_flag=True, help="Print a JSON object on stdout.")
@click.option("--layers", type=click.IntRange(min=1), help="Check only the blocks of the first so many layers.")
@click.option("--no-limits", is_flag=True, help="Check a file however large or slow it is: for files you trust.")
@click.option("--quiet", "-q", is_flag=True, help="Print nothing: the exit code is the answer.")
@timeout_option
@click.pass_context
def validate(ctx: click.Context, file: str, as_json: bool, layers: int | None, no_limits: bool, quiet: bool) -> None:
    """Check FILE (a path, a URL or -) against every rule of the specification.

    All tiles are decoded. Checking goes on past a fault where it can, so that all damage is listed, one line each:
    'error: ID @ OFFSET: MESSAGE'. The last line says how many layers, from the first, decode in every tile. Exit code
    0 if there is no error (a warning is none), else 1.

    \b
    Examples:
      scarfmt validate scene.scar
      scarfmt validate scene.scar --json | jq -r '.findings[].refusal'
    """
    from scarfmt.limits import DEFAULT_LIMITS, FORMAT_LIMITS
    from scarfmt.tools import validate as validation

    limits = FORMAT_LIMITS if no_limits else DEFAULT_LIMITS
    with open_input(file) as source, progress(quiet or as_json) as report:
        result = validation.validate(source, layers=layers, limits=limits, report=report)
    if as_json:
        print_json({"file": file, **result.as_json()})
    elif not quiet:
        _print(file, result)
    if not result.valid:
        ctx.exit(FAILED)


def _print(file: str, result: Validation) -> None:
    for finding in result.findings:
        click.echo(_line(finding), err=True)
    verdict = "valid" if result.valid else "not valid"
    layers = f"{result.layers_readable} of {result.layers_declared} layers readable"
    if result.layers_checked < result.layers_available:
        layers += f", {result.layers_checked} checked"
    work = f"{result.blocks_checked:,} blocks and {result.tiles_decoded:,} tiles sound"
    click.echo(f"{file}: {verdict}; {layers}, {work}", err=True)


def _line(finding: Finding) -> str:
    place = "?" if finding.offset is None else str(finding.offset)
    subject = "" if finding.field is None else f" ({finding.field})"
    return f"{finding.severity}: {finding.refusal} @ {place}: {finding.message}{subject}"
